"""Units and axes of logs, by the words of maps."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Factors to SI units, by quantity.
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
ANGLE = {"rad": 1.0, "deg": np.pi / 180.0}
SPEED = {f"{unit}/s": factor for unit, factor in LENGTH.items()}
ANGULAR_SPEED = {f"{unit}/s": factor for unit, factor in ANGLE.items()}
VOLTAGE = {"V": 1.0, "mV": 1e-3}
ACCELERATION = {"m/s2": 1.0, "mm/s2": 1e-3, "g": 9.80665}

_HALF = np.sqrt(0.5)
#: Rotations to the library's axes, [w, x, y, z]: world x north, y west, z up; body x forward, y left, z up.
WORLD = {"nwu": (1.0, 0.0, 0.0, 0.0), "enu": (_HALF, 0.0, 0.0, -_HALF), "ned": (0.0, 1.0, 0.0, 0.0)}
BODY = {"flu": (1.0, 0.0, 0.0, 0.0), "frd": (0.0, 1.0, 0.0, 0.0)}
