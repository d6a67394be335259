"""Sums with waves of many orders are those that are added up pose by pose."""

import numpy as np
import pytest
from scipy import sparse

from pipeline.positions.law_sums import sums
from pipeline.positions.laws import Inputs, JointLaw

POSES = 70


@pytest.fixture(scope="module")
def inputs():
    rng = np.random.default_rng(8)
    q = rng.uniform(-6.0, 6.0, (POSES, 2))
    return Inputs(q, np.zeros((POSES, 2)), *np.zeros((3, POSES)))


def waves(*orders):
    return [JointLaw(2, "periodic", "angle", 2, order) for order in orders]


@pytest.mark.parametrize(
    "laws",
    [
        waves(0.25),
        waves(0.5, 0.75, 12.0),
        waves(*np.arange(0.5, 300.01, 0.25).tolist()),
        waves(1.0, 1.013),  # no multiples of the step
        [JointLaw(2, "coupling", "angle", 1, order) for order in (1.0, 2.0, 3.0)],
    ],
    ids=["one", "few", "all", "between", "coupled"],
)
def test_sums_are_those_of_each_pose(inputs, laws):
    rng = np.random.default_rng(9)
    columns = rng.normal(size=(POSES, 5))
    few = sparse.csr_array(np.where(rng.random((POSES, 5)) < 0.2, columns, 0.0))
    w = rng.uniform(0.5, 2.0, POSES)
    g = sums(laws, inputs, 0.25)

    told, of_few, squares = g.of(columns), g.of(few), g.weighed(w)

    for k, law in enumerate(laws):
        phase = law.order * inputs.q[:, law.source - 1]
        both = np.array([np.cos(phase), np.sin(phase)])
        own = slice(2 * k, 2 * k + 2)
        assert told[own] == pytest.approx(both @ columns, abs=1e-10)
        assert of_few[own] == pytest.approx(both @ few.toarray(), abs=1e-10)
        assert squares[k] == pytest.approx(both * w @ both.T, abs=1e-10)


def test_laws_of_one_amplitude_are_summed_as_they_are(inputs):
    laws = [JointLaw(1, "smooth", "angle", 2, degree, 0.0, 6.0) for degree in (2.0, 3.0)]
    w = np.linspace(1.0, 2.0, POSES)
    g = sums(laws, inputs, 0.25)

    f = np.array([(inputs.q[:, 1] / 6.0) ** degree for degree in (2.0, 3.0)])
    assert g.of(w[:, None])[:, 0] == pytest.approx(f @ w)
    assert g.weighed(w)[:, 0, 0] == pytest.approx(f**2 @ w)
