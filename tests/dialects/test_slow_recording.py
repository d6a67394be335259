"""A recording of a robot that moves slowly between its poses."""

import numpy as np

from pipeline.dialects.recorded import table


def test_a_motion_of_less_than_encoder_noise_per_row_is_no_standstill():
    """Six axes stand for 10 s at 0 and at 9 deg; between, they take 12 s at 0.009 deg a row."""
    along = np.concatenate([np.zeros(800), np.linspace(0.0, 9.0, 1000), np.full(800, 9.0)])
    rows = [f"{0.012 * k:.3f};" + ";".join([f"{q:.4f}"] * 6) for k, q in enumerate(along)]
    head = ";".join(["time [s]", *(f"A{k} [deg]" for k in range(1, 7))])
    found = table("\n".join([head, *rows, ""]).encode())

    values = [
        [float(cell) for cell in line.split("\t")] for line in found.decode().splitlines()[1:]
    ]
    assert np.allclose(values, [[1.0, *[0.0] * 6], [2.0, *[9.0] * 6]], atol=0.02)
