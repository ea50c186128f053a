"""Actuators of MJCF as limits of joints and as thrusters; equalities as joints that follow others."""

from typing import Any

import numpy as np

from uvms_gym._rotations import matrices


def _range(model: Any, actuator: int) -> tuple[float, float] | None:
    """Least and largest force of an actuator before its gear, N; None if it has no limits."""
    from mujoco import mjtBias, mjtGain

    limits = []
    if model.actuator_forcelimited[actuator]:
        limits.append(tuple(model.actuator_forcerange[actuator]))
    direct = model.actuator_gaintype[actuator] == mjtGain.mjGAIN_FIXED
    direct = direct and model.actuator_biastype[actuator] == mjtBias.mjBIAS_NONE
    if direct and model.actuator_ctrllimited[actuator]:
        gain = model.actuator_gainprm[actuator, 0]
        limits.append(tuple(sorted(gain * model.actuator_ctrlrange[actuator])))
    if not limits:
        return None
    return max(low for low, _ in limits), min(high for _, high in limits)


def _lag(model: Any, actuator: int) -> float | None:
    from mujoco import mjtDyn

    filters = (mjtDyn.mjDYN_FILTER, mjtDyn.mjDYN_FILTEREXACT)
    return float(model.actuator_dynprm[actuator, 0]) if mjtDyn(model.actuator_dyntype[actuator]) in filters else None


def actuators(reader: Any, joints: dict[str, dict[str, Any]]) -> tuple[list[dict[str, Any]], set[int]]:
    """Thrusters, and the sites that they are at; joints get their effort, in place."""
    from mujoco import mjtTrn

    model, notes = reader.model, reader.notes
    thrusters, used, reported = list[dict[str, Any]](), set[int](), list[str]()
    for i in range(model.nu):
        name, target = reader._name("ACTUATOR", i) or f"actuator-{i + 1}", int(model.actuator_trnid[i, 0])
        kind, gear, limits = mjtTrn(model.actuator_trntype[i]), model.actuator_gear[i], _range(model, i)
        if kind in (mjtTrn.mjTRN_JOINT, mjtTrn.mjTRN_JOINTINPARENT):
            joint = joints.get(reader._joint_name(target))
            if joint is not None and joint["kind"] not in ("floating", "fixed"):
                if limits is not None:
                    joint["effort"] = float(max(abs(limits[0]), abs(limits[1])) * abs(gear[0]))
                continue
        force = float(np.linalg.norm(gear[:3]))
        body = int(model.site_bodyid[target]) if kind == mjtTrn.mjTRN_SITE else -1
        if body not in reader.kept or force == 0.0:
            reported.append(name)
            continue
        turn = matrices(np.asarray(model.site_quat[target], dtype=np.float64))
        used.add(target)
        if np.any(gear[3:]):
            notes.append(f"{name}: the torque of its gear is left out")
        thruster = {
            "name": name,
            "link": reader.names[body],
            "position": (model.site_pos[target] - reader.offset[body]).tolist(),
            "axis": (turn @ gear[:3] / force).tolist(),
            "limits": None if limits is None else [float(limits[0] * force), float(limits[1] * force)],
            "lag": _lag(model, i),
        }
        thrusters.append(thruster)
    for i in range(model.njnt):
        joint = joints.get(reader._joint_name(i))
        if joint is not None and model.jnt_actfrclimited[i]:
            most = float(np.max(np.abs(model.jnt_actfrcrange[i])))
            joint["effort"] = min(most, joint.get("effort") or most)
    if reported:
        notes.append(f"{', '.join(reported)}: neither a joint's motor nor a force at a site: left out")
    return thrusters, used


def couplings(reader: Any, joints: dict[str, dict[str, Any]]) -> None:
    """Let joints follow others where an equality says so; note the other equalities."""
    from mujoco import mjtEq

    model, left = reader.model, 0
    for i in range(model.neq):
        one, two = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
        entry = joints.get(reader._joint_name(one)) if model.eq_type[i] == mjtEq.mjEQ_JOINT else None
        constant, slope, *higher = (float(x) for x in model.eq_data[i, :5])
        if entry is None or two < 0 or any(higher) or entry["kind"] in ("floating", "fixed"):
            left += 1
            continue
        zero = [float(model.qpos0[model.jnt_qposadr[j]]) for j in (one, two)]
        offset = constant + zero[0] - slope * zero[1]
        entry["mimic"] = {"joint": reader._joint_name(two), "multiplier": slope, "offset": offset}
    if left:
        reader.notes.append(f"{left} of its equality constraints: left out, as scenes have no closed loops")
