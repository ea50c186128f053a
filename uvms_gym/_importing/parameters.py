"""Vehicles from YAML: tables of hydrodynamic parameters in Fossen's notation, in two layouts.

Tables: the parameter files of uuv_simulator's model-based controllers, also as ROS 2 parameters: mass, inertia,
centres, volume or buoyancy, and six diagonal numbers or six rows of six each of added mass and damping. Derivatives:
one number a key in the notation of SNAME and of Fossen's toolbox MSS, X_udot, Y_v, N_r|r| and so on.
"""

import re
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from uvms_gym import _files
from uvms_gym._core import SceneError
from uvms_gym._rotations import Floats

#: Maximum size of a file, bytes, and maximum number and depth of its entries: short YAML can stand for very long data.
_MOST, _ENTRIES, _DEPTH = 1_000_000, 10_000, 12

#: Keys of each quantity in files that are in use.
_KEYS = {
    "mass": ("mass", "m", "mass_kg"),
    "weight": ("W", "weight"),
    "volume": ("volume", "V", "displacement_m3"),
    "buoyancy": ("B", "buoyancy"),
    "density": ("density", "rho", "water_density", "fluid_density"),
    "gravity": ("g", "gravity"),
    "cog": ("cog", "center_of_gravity", "center_of_mass", "r_G", "rG", "r_g", "g_center"),
    "cob": ("cob", "center_of_buoyancy", "r_B", "rB", "r_b", "b_center"),
    "inertia": ("inertia", "inertial", "I_b", "I_g", "tensor"),
    "added_mass": ("Ma", "M_A", "MA", "added_mass"),
    "linear": ("linear_damping", "damping_linear", "D_lin", "lin_damp"),
    "quadratic": ("quad_damping", "quadratic_damping", "damping_nonlinear", "D_quad", "quad_damp"),
    "linear_forward_speed": ("linear_damping_forward_speed",),
    "allocation": ("tam", "TAM"),
    "name": ("name", "model"),
    "axes": ("axes",),
}
_TABLES = ("added_mass", "linear", "quadratic", "linear_forward_speed")

_FORCES, _SPEEDS = "XYZKMN", "uvwpqr"
_DERIVATIVE = re.compile(
    r"([XYZKMN])_?(?:(d_?)?([uvwpqr])_?(dot|d)?"  # X_udot, Xu_dot, Xdu, X_u
    r"|\|?([uvwpqr])_?\|?(?:abs_?|a)?\|?([uvwpqr])\|?)(?:_(l|q))?"  # X_uu, X_u|u|, Xuabsu, Xuau, Y_uv; X_u_l and X_u_q
)

#: NED (x forward, y starboard, z down) to x forward, y left, z up.
_NED = np.array([1.0, -1.0, -1.0])

_EXPECTED = (
    "expected either tables (mass, inertia, cog, cob, volume or buoyancy, Ma or added_mass, linear_damping, "
    "quad_damping) or derivatives (m, Ix, Iy, Iz, zG, zB, W, B, X_udot to N_rdot, X_u to N_r, X_uu to N_rr)"
)


def read(path: Path) -> dict[str, Any]:
    """Read a vehicle, in the form of `read_robot`.

    Raises
    ------
    SceneError
        The message names file and key.
    """
    return _Vehicle(path, _parse(path)).robot()


def _parse(path: Path) -> dict[str, Any]:
    try:
        import yaml
    except ModuleNotFoundError:
        raise SceneError(f"{path}: YAML needs pyyaml; run: pip install 'uvms-gym[import]'") from None
    try:
        data = yaml.safe_load(_files.read_text(path, _MOST))
    except OSError as error:
        raise SceneError(f"{path}: {error.strerror}") from None
    except (UnicodeDecodeError, RecursionError) as error:
        raise SceneError(f"{path}: no readable YAML: {type(error).__name__}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark else ""
        raise SceneError(f"{path}: {line}{getattr(error, 'problem', None) or 'no readable YAML'}") from None
    if not isinstance(data, dict):
        raise SceneError(f"{path}: holds no keys: {_EXPECTED}")
    return data


class _Vehicle:
    """Quantities of one file, by their key."""

    def __init__(self, path: Path, data: dict[str, Any]) -> None:
        self.path, self.notes = path, list[str]()
        self.values: dict[str, Any] = {}
        self.thrusters: Any = None
        self.count = 0
        self._collect(data, 0)
        self.stated = {}
        for quantity, keys in _KEYS.items():
            found = [key for key in keys if key in self.values]
            if len(found) > 1 and quantity != "name":
                self._fail(f"{found[0]} and {found[1]}", "are the same quantity: state one")
            if found:
                self.stated[quantity] = found[0]

    def _fail(self, key: str, problem: str) -> NoReturn:
        raise SceneError(f"{self.path}: {key}: {problem}")

    def _collect(self, data: Any, depth: int) -> None:
        """Gather keys of all levels; gains of controllers are left out, whose names are those of derivatives."""
        if isinstance(data, list):
            entries = [pair for item in data if isinstance(item, dict) and len(item) == 1 for pair in item.items()]
        else:
            entries = list(data.items())
        keys = {str(key) for key, _ in entries}
        gains = keys & {"Kp", "kp", "p"} and keys & {"Ki", "ki", "i", "Kd", "kd", "d"}
        for key, value in () if gains else entries:
            self.count += 1
            if self.count > _ENTRIES or depth > _DEPTH:
                raise SceneError(f"{self.path}: has more than {_ENTRIES} entries or {_DEPTH} levels")
            name = str(key)
            if name == "thrusters" and isinstance(value, list):
                self.thrusters = value
                continue
            known = any(name in keys for keys in _KEYS.values())
            if isinstance(value, dict) and not (known and set(value) & {"ixx", "Ixx"}):
                self._collect(value, depth + 1)
            elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
                self._collect(value, depth + 1)
            elif known or _DERIVATIVE.fullmatch(name) or re.fullmatch(r"I_?[xyz]{1,2}|[xyz]_?[GBgb]", name):
                if name in self.values and self.values[name] != value:
                    self._fail(name, "is given twice, with different values")
                self.values[name] = value

    def _numbers(self, key: str, value: Any, *shapes: tuple[int, ...]) -> Floats:
        """Finite numbers of one of these shapes; YAML reads 1e-5 as text."""
        try:
            array = np.array(value, dtype=np.float64)
        except (TypeError, ValueError):
            array = np.array(np.nan)
        if array.shape not in shapes or not np.all(np.abs(array) <= 1e12):
            forms = " or ".join(" x ".join(map(str, shape)) or "one" for shape in shapes)
            text = str(value)
            shown = text if len(text) <= 60 else f"{text[:60]}..."
            self._fail(key, f"is {shown}, but must be {forms} finite number{'s' * (shapes != ((),))}")
        return array

    def _scalar(self, quantity: str) -> float | None:
        key = self.stated.get(quantity)
        if key is None:
            return None
        value = float(self._numbers(key, self.values[key], ()))
        if value <= 0.0:
            self._fail(key, f"is {value:g}, but must be > 0")
        return value

    def _first(self, names: list[str]) -> float | None:
        """Number of the first key that is given."""
        found = next((name for name in names if name in self.values), None)
        return None if found is None else float(self._numbers(found, self.values[found], ()))

    def _centre(self, quantity: str, letter: str) -> Floats:
        key = self.stated.get(quantity)
        if key is not None:
            return self._numbers(key, self.values[key], (3,))
        parts = []
        for axis in "xyz":
            names = [f"{axis}{mid}{end}" for mid in ("", "_") for end in (letter, letter.lower())]
            parts.append(self._first(names) or 0.0)
        return np.array(parts)

    def _inertia(self) -> Floats:
        key = self.stated.get("inertia")
        if key is not None:
            value = self.values[key]
            if isinstance(value, dict):
                named = {str(name).lower(): entry for name, entry in value.items()}
                value = [named.get(name, 0.0) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
            array = self._numbers(key, value, (3,), (6,), (9,), (3, 3))
            if array.shape == (6,):
                xx, xy, xz, yy, yz, zz = array.tolist()
                return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            return np.diag(array) if array.shape == (3,) else array.reshape(3, 3)
        moments = []
        for axis in "xyz":
            names = [f"I{mid}{axis * times}" for mid in ("", "_") for times in (1, 2)]
            moment = self._first(names)
            if moment is None:
                self._fail(f"I{axis}", f"is missing: {_EXPECTED}")
            moments.append(moment)
        products = [name for name in self.values if re.fullmatch(r"I_?(xy|xz|yz)", name) and self.values[name]]
        if products:
            self.notes.append(f"{', '.join(products)}: left out: files differ in the sign of products of inertia")
        return np.diag(moments)

    def _table(self, quantity: str) -> Floats:
        key = self.stated.get(quantity)
        if key is None:
            return np.zeros((6, 6))
        array = self._numbers(key, self.values[key], (6,), (36,), (6, 6))
        table = np.diag(array) if array.shape == (6,) else array.reshape(6, 6)
        if quantity == "linear_forward_speed":
            return -table
        return self._magnitudes(key, table)

    def _magnitudes(self, what: str, table: Floats) -> Floats:
        """The matrix with a diagonal >= 0: files state derivatives, which are negative, or magnitudes."""
        diagonal = np.diag(table)
        if np.any(diagonal < 0.0) and np.any(diagonal > 0.0):
            self._fail(what, f"has diagonal entries of both signs: {diagonal.tolist()}")
        return -table if np.any(diagonal < 0.0) else table

    def _derivatives(self) -> dict[str, Floats]:
        """Matrices of the derivatives."""
        tables = {quantity: np.zeros((6, 6)) for quantity in _TABLES}
        left = []
        for name, value in self.values.items():
            found = _DERIVATIVE.fullmatch(name)
            if found is None:
                continue
            force, before, speed, after, one, two, kind = found.groups()
            number = float(self._numbers(name, value, ()))
            if one is None:
                quantity = "added_mass" if before or after else "quadratic" if kind == "q" else "linear"
                tables[quantity][_FORCES.index(force), _SPEEDS.index(speed)] = number
            elif one == two:
                tables["quadratic"][_FORCES.index(force), _SPEEDS.index(one)] = number
            elif "u" in (one, two):
                other = two if one == "u" else one
                tables["linear_forward_speed"][_FORCES.index(force), _SPEEDS.index(other)] = -number
            elif number != 0.0:
                left.append(name)
        if left:
            self.notes.append(
                f"{', '.join(left)}: left out: products of two speeds other than u have no place in a scene"
            )
        for quantity in _TABLES[:3]:
            tables[quantity] = self._magnitudes(quantity, tables[quantity])
        return tables

    def _thrusters(self, flip: Floats) -> list[dict[str, Any]]:
        """Thrusters of `thrusters` (position and axis), or of the columns of an allocation matrix."""
        thrusters = []
        for i, entry in enumerate(self.thrusters or ()):
            key = f"thrusters[{i}]"
            if not isinstance(entry, dict) or not {"position", "axis"} <= set(entry):
                self._fail(key, "must have position and axis, three numbers each, and may have limits and name")
            position, axis = (self._numbers(f"{key}.{k}", entry[k], (3,)) * flip for k in ("position", "axis"))
            limits = entry.get("limits")
            if limits is not None:
                limits = self._numbers(f"{key}.limits", limits, (2,)).tolist()
            name = str(entry.get("name", f"thruster-{i + 1}"))
            thrusters.append({"name": name, "position": position.tolist(), "axis": axis.tolist(), "limits": limits})
        key = self.stated.get("allocation", "")
        if key and not thrusters:
            value = self.values[key]
            columns = len(value[0]) if isinstance(value, list) and value and isinstance(value[0], list) else 1
            for i, column in enumerate(self._numbers(key, value, (6, columns)).T):
                force, moment = column[:3] * flip, column[3:] * flip
                square = float(force @ force)
                if square < 1e-12:
                    self._fail(key, f"column {i + 1} has no force, so that it is no thruster's")
                position = np.cross(force, moment) / square
                if abs(float(force @ moment)) > 1e-3 * square:
                    self.notes.append(f"thruster-{i + 1}: the torque about its axis is left out")
                entry = {"name": f"thruster-{i + 1}", "position": position.tolist()}
                thrusters.append(entry | {"axis": (force / square**0.5).tolist(), "limits": None})
        return thrusters

    def robot(self) -> dict[str, Any]:
        """The vehicle: one link, in axes x forward, y left, z up."""
        tables = any(quantity in self.stated for quantity in _TABLES)
        named = any(_DERIVATIVE.fullmatch(name) for name in self.values)
        if not tables and not named:
            raise SceneError(f"{self.path}: has no added mass and no damping: {_EXPECTED}")
        matrices = {quantity: self._table(quantity) for quantity in _TABLES} if tables else self._derivatives()
        if tables and named:
            extra = ", ".join(name for name in self.values if _DERIVATIVE.fullmatch(name))
            self.notes.append(f"{extra}: left out beside the tables of added mass and damping")
        axes = str(self.values.get("axes", "flu" if tables else "ned"))
        if axes not in ("flu", "ned"):
            self._fail("axes", f'is "{axes}", but must be "flu" or "ned"')
        flip = _NED if axes == "ned" else np.ones(3)
        how = "as of uuv_simulator's parameters" if tables else "as of Fossen's derivatives"
        points = "z down" if axes == "ned" else "z up"
        if "axes" not in self.values:
            self.notes.append(f"axes: centres and thrusters {points}, matrices z down, {how}; `axes` states others")
        stated_axes = _NED if "axes" not in self.values or axes == "ned" else np.ones(3)
        both = np.diag(np.concatenate([stated_axes, stated_axes]))
        gravity, weight = self._scalar("gravity") or 9.81, self._scalar("weight")
        mass = self._scalar("mass") or (None if weight is None else weight / gravity)
        if mass is None:
            self._fail("mass", f"is missing: {_EXPECTED}")
        water: dict[str, Any] = {quantity: (both @ matrix @ both).tolist() for quantity, matrix in matrices.items()}
        water["center_of_buoyancy"] = (self._centre("cob", "B") * flip + 0.0).tolist()
        volume, buoyancy = self._scalar("volume"), self._scalar("buoyancy")
        if buoyancy is not None and volume is None and 0.5 * mass < buoyancy < 2.0 * mass:
            self.notes.append(f"{self.stated['buoyancy']}: {buoyancy:g} is near the mass: taken for kg of water")
            buoyancy *= gravity
        if volume is None and buoyancy is None:
            self.notes.append("volume: not stated: neutrally buoyant")
        density = self._scalar("density")
        water |= {"volume": volume, "buoyancy": None if volume else buoyancy, "neutral": not (volume or buoyancy)}
        inertia = self._inertia()
        turn = np.diag(flip)
        centre = self._centre("cog", "G") * flip + 0.0
        inertial = {"mass": mass, "position": centre.tolist(), "inertia": (turn @ inertia @ turn).tolist()}
        name = str(self.values.get(self.stated.get("name", ""), self.path.stem))
        link = {"name": name, "inertial": inertial, "water": water}
        thrusters = [thruster | {"link": name} for thruster in self._thrusters(flip)]
        common = {
            "name": name,
            "source": str(self.path),
            "format": "YAML",
            "fluid_density": density,
            "notes": self.notes,
        }
        return common | {"links": [link | {"shapes": [], "meshes": []}], "joints": [], "thrusters": thrusters}
