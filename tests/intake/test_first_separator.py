"""Names whose first part is the target, and whose others are the group."""

from pipeline.intake._separators import _pairs, _ways


def test_a_name_is_cut_at_the_last_or_at_the_first_separator():
    """`P1_pose03_loaded` is the target `loaded` of a group, or the target P1 of `pose03_loaded`."""
    last, first = (_pairs(["P1_pose03_loaded"], way) for way in _ways("_"))

    assert last == [("P1_pose03", "loaded")]
    assert first == [("pose03_loaded", "P1")]
