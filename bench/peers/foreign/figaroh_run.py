"""FIGAROH on a trial, as in its documentation: python figaroh_run.py FOLDER OUT [springs].

Runs in its own environment (figaroh.txt); imports nothing of the project.
"""

import sys

import numpy as np
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm
from figaroh.tools.robot import load_robot


class Arm(BaseCalibration):
    """Calibration with the weights of metres and radians of its example for this make of robots."""

    def cost_function(self, var):
        """Weighted residuals to be minimised."""
        told = calc_updated_fkm(self.model, self.data, var, self.q_measured, self.calib_config)
        off = self._compute_logmap_residuals(self.PEE_measured, told)
        return self.apply_measurement_weighting(off, pos_weight=1.0, orient_weight=0.5)


folder, out, *more = sys.argv[1:]
arm = Arm(load_robot(f"{folder}/robot.urdf"), f"{folder}/figaroh.yaml")
arm.calib_config["known_baseframe"] = False
arm.calib_config["known_tipframe"] = False
springs, arm.calib_config["param_name"] = arm.calib_config["param_name"], []
arm.initialize()
if more:  # behind the others: 1.0.2 writes the names of the base frame over those that come first
    arm.calib_config["param_name"] += springs
    arm.eliminate_absorbed_parameters()
arm.solve(enable_logging=False)
held = dict(arm.calib_config, NbSample=len(arm._q_val))
told = calc_updated_fkm(arm.model, arm.data, arm.LM_result.x, arm._q_val, held)
np.savetxt(out, told.reshape(-1, len(arm._q_val))[:3].T, delimiter=",")
with open(out.replace(".csv", ".txt"), "w") as file:
    for name, value in zip(arm.calib_config["param_name"], arm.LM_result.x, strict=True):
        print(f"{name} {value:.9g}", file=file)
