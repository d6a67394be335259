"""A wander of the instrument in place of spells of noise, with the parts of the noise as stubs."""

from types import SimpleNamespace

import pytest

from pipeline.system import noise_shape as module


@pytest.mark.parametrize(
    ("wander", "beside", "kept"),
    [(0.4, False, True), (0.9, True, True), (0.9, False, False)],
)
def test_spells_give_way_to_a_wander_that_explains_them(monkeypatch, wander, beside, kept):
    """One likelier than not without them, beside which they are not likelier than not any more."""
    slow = SimpleNamespace(probability=wander, factor=7.0)
    monkeypatch.setattr(module, "_wander", lambda *_: slow)
    monkeypatch.setattr(module, "replace", lambda of, **new: SimpleNamespace(**vars(of) | new))
    seen = SimpleNamespace(data=SimpleNamespace(wander=None))
    alone = ("parts", (0, SimpleNamespace(in_spells=False), 2, 3))

    def ends(of, spells=True):
        if not spells:
            return alone
        assert of.data.wander == 7.0
        return "parts", (0, SimpleNamespace(in_spells=beside), 2, 3)

    spells = ("spells", "told", "slow")
    out = module._against_wander(seen, ends, spells)

    assert out == (spells if kept else (*alone, slow))
