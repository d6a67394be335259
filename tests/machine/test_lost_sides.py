"""Values for one sign of the torque, if compliances are not determined."""

import numpy as np

from pipeline.machine.sides import taken


def test_one_undetermined_parameter_is_enough_to_know_nothing():
    """Two parameters without information: c + dc has one of them, c none; its variance stays."""
    cov = np.diag([4.0, np.inf, np.inf])
    value, found = taken(np.array([1.0, 2.0, 3.0]), cov, np.array([[1.0, 1, 0], [1, 0, 0]]))

    assert value.tolist() == [3.0, 1.0]
    assert np.diag(found).tolist() == [np.inf, 4.0]
