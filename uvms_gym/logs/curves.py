"""Curves of thrusters: thrust by pulse width and supply voltage."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uvms_gym._core import thrust_of
from uvms_gym._files import read_text
from uvms_gym.logs.errors import LogError, reading
from uvms_gym.logs.units import Floats


@dataclass(frozen=True, eq=False)
class Curve:
    """Thrust over commands, such as pulse widths, and supply voltages; linear between them."""

    #: (k,) commands, increasing.
    command: Floats
    #: (v,) voltages, V, increasing; empty: at any voltage.
    voltage: Floats
    #: (k, v) thrusts, N; (k, 1) at any voltage.
    thrust: Floats
    #: Voltage where none is known, V; None: it must be known.
    usual: float | None = None

    @property
    def needs_voltage(self) -> bool:
        """Whether the thrust depends on the voltage, and there is no usual one."""
        return len(self.voltage) > 0 and self.usual is None

    def __call__(self, command: Floats, voltage: Floats | None = None) -> Floats:
        """Thrusts (n,), N, of commands (n,) at voltages (n,) or the usual one; no pulse, 0, gives none."""
        columns = np.stack([np.interp(command, self.command, column) for column in self.thrust.T], axis=-1)
        if len(self.voltage):
            known = np.full(len(command), self.usual) if voltage is None else voltage
            places = np.interp(known, self.voltage, np.arange(len(self.voltage), dtype=np.float64))
            low = np.minimum(places.astype(np.int64), len(self.voltage) - 2)
            share = (places - low)[:, None]
            columns = np.take_along_axis(columns, np.stack([low, low + 1], axis=-1), axis=1)
            columns = columns[:, :1] * (1.0 - share) + columns[:, 1:] * share
        return np.where(self._silent(command), 0.0, columns[:, 0])

    def outside(self, command: Floats) -> NDArray[np.int64]:
        """Indices of commands (n,) beyond the curve's; no pulse is not beyond them."""
        beyond = (command < self.command[0]) | (command > self.command[-1])
        return np.flatnonzero(beyond & ~self._silent(command))

    def _silent(self, command: Floats) -> NDArray[np.bool_]:
        return np.asarray((command == 0.0) & (self.command[0] > 0.0))


def curve_of(points: object) -> Curve:
    """Curve of points [command, N].

    Raises
    ------
    ValueError
        Other data; without text.
    """
    try:
        found = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        found = np.empty(0)
    fits = found.ndim == 2 and found.shape[0] >= 2 and found.shape[1] == 2 and bool(np.isfinite(found).all())
    if not fits or not np.all(np.diff(found[:, 0]) > 0.0):
        raise ValueError
    return Curve(found[:, 0], np.empty(0), found[:, 1:])


def read_curve(path: Path) -> Curve:
    """Read a curve from a file of comma-separated values with increasing commands in the first column.

    The second column is thrust, N; or several columns are, by supply voltage, which names them as in "16V".
    """
    with reading(path):
        lines = [line for line in read_text(path).splitlines() if line.strip() and not line.startswith("#")]
    names = [cell.strip() for cell in lines[0].split(",")] if lines else []
    try:
        voltage = np.array(
            [float(name.rstrip("Vv ")) for name in names[1:]] if len(names) > 2 else [], dtype=np.float64
        )
        rows = np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])
        points = curve_of(rows[:, :2])
        if rows.shape[1] != len(names) or not np.isfinite(rows).all() or not np.all(np.diff(voltage) > 0.0):
            raise ValueError
    except (ValueError, IndexError):
        raise LogError(
            f'{path}: no curve: a line of names, then lines "command,N" or, with increasing voltages as names such as '
            '"16V", "command,N,N,..."; commands increase'
        ) from None
    return Curve(points.command, voltage, rows[:, 1:])


def _t200() -> Curve:
    """Bench table `"t200"` of scenes, 10 to 20 V."""
    pulses, voltages = np.arange(1100.0, 1901.0, 20.0), np.arange(10.0, 21.0, 2.0)
    thrusts = thrust_of(np.tile(pulses[:, None], len(voltages)), "t200", np.tile(voltages, (len(pulses), 1)))
    return Curve(pulses, voltages, thrusts, usual=16.0)


#: Curves by name.
CURVES = {"t200": _t200}
