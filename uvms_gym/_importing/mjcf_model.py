"""The process that reads MJCF: prints a robot as JSON, or a sentence that says why it cannot be read."""

import json
import re
import resource
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from uvms_gym._rotations import Floats, about, matrices, rpy_of

#: Part of a body's mass and moments that moves with each further joint of the body, as a link needs mass.
_CARRIER = 1e-3

#: Densities of water, kg/m3; models of swimming have others.
_WATER = (900.0, 1100.0)

_WORLD = "world"


class _Refused(ValueError):
    """A file that cannot be a robot; the message is the reason, without the file."""


def _compile(path: str) -> tuple[Any, list[str]]:
    """The compiled model, without meshes whose files are missing; notes."""
    import mujoco

    notes: list[str] = []
    spec = mujoco.MjSpec.from_file(path)
    folder = Path(path).parent
    missing = {}
    for mesh in list(spec.meshes):
        file = folder / spec.meshdir / mesh.file
        if mesh.file and not file.is_file():
            missing[mesh.name or Path(mesh.file).stem] = mesh.file
            spec.delete(mesh)
    for geom in list(spec.geoms):
        if geom.meshname in missing:
            notes.append(f"{geom.parent.name or _WORLD}: mesh not read: there is no file {missing[geom.meshname]}")
            spec.delete(geom)
    # Pictures on surfaces are not needed, and their files may be missing.
    for texture in spec.textures:
        if texture.file or any(texture.cubefiles):
            texture.file, texture.cubefiles = "", [""] * len(texture.cubefiles)
            texture.builtin, texture.width, texture.height = mujoco.mjtBuiltin.mjBUILTIN_FLAT, 1, 1
    for skin in list(spec.skins):
        spec.delete(skin)
    return spec.compile(), notes


class _Reader:
    """Conversion of one model."""

    def __init__(self, model: Any, path: str, notes: list[str]) -> None:
        import mujoco

        self.mj, self.model, self.notes = mujoco, model, notes
        self.path = path
        self.links: list[dict[str, Any]] = []
        self.joints: list[dict[str, Any]] = []
        self.offset = np.zeros((model.nbody, 3))
        taken = Counter[str]()
        self.names = [self._unique(self._name("BODY", i) or f"body-{i}", taken) for i in range(model.nbody)]
        self.taken = taken
        self.kept = self._kept()
        # The world: a parent of what does not move freely, or of the free joint.
        self._link(_WORLD, None)
        for body in sorted(self.kept):
            self._body(body)

    def _unique(self, name: str, taken: Counter[str]) -> str:
        taken[name] += 1
        return name if taken[name] == 1 else f"{name}-{taken[name]}"

    def _name(self, kind: str, index: int) -> str:
        return self.mj.mj_id2name(self.model, getattr(self.mj.mjtObj, f"mjOBJ_{kind}"), int(index)) or ""

    def _of(self, body: int, kind: str) -> range:
        """Indices of a body's joints ("jnt") or geoms ("geom")."""
        first, count = (int(getattr(self.model, f"body_{kind}{part}")[body]) for part in ("adr", "num"))
        return range(first, first + count) if first >= 0 else range(0)

    def _joint_name(self, joint: int) -> str:
        body = int(self.model.jnt_bodyid[joint])
        number = joint - int(self.model.body_jntadr[body])
        return self._name("JOINT", joint) or f"{self.names[body]}-joint" + (f"-{number + 1}" if number else "")

    def _free(self, body: int) -> bool:
        """True if a body is free: by a free joint, or by three or more joints to the world, two of them slides."""
        kinds = [int(self.model.jnt_type[j]) for j in self._of(body, "jnt")]
        slides, hinges = (kinds.count(int(k)) for k in (self.mj.mjtJoint.mjJNT_SLIDE, self.mj.mjtJoint.mjJNT_HINGE))
        return int(self.mj.mjtJoint.mjJNT_FREE) in kinds or (
            self.model.body_parentid[body] == 0 and slides >= 2 and slides + hinges >= 3
        )

    def _kept(self) -> set[int]:
        """Bodies of the robot: of the trees with joints, those with actuators; of free trees, the largest."""
        model, roots = self.model, self.model.body_rootid
        trees = {int(r): [i for i in range(1, model.nbody) if roots[i] == r] for r in roots if r > 0}
        if not trees:
            raise _Refused("has no <body>: a robot needs at least one")
        moving = {r: bodies for r, bodies in trees.items() if any(model.body_jntnum[i] for i in bodies)}
        driven = {int(roots[body]) for body in self._driven()}
        chosen = {r: bodies for r, bodies in moving.items() if r in driven} or moving or trees
        free = {r: bodies for r, bodies in chosen.items() if self._free(r)}
        if free:
            root = max(free, key=lambda r: (len(free[r]), float(model.body_subtreemass[r])))
            chosen = {root: free[root]}
        left = [self.names[r] for r in trees if r not in chosen]
        if left:
            self.notes.append(f"{', '.join(left)}: no part of the robot: left out with all that they carry")
        return {i for bodies in chosen.values() for i in bodies}

    def _driven(self) -> Iterator[int]:
        """Bodies of joints and sites with actuators."""
        model, kinds = self.model, self.mj.mjtTrn
        of_joint = (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT)
        for kind, (target, _) in zip(model.actuator_trntype, model.actuator_trnid):
            if kinds(kind) in of_joint:
                yield int(model.jnt_bodyid[target])
            elif kinds(kind) == kinds.mjTRN_SITE:
                yield int(model.site_bodyid[target])

    def _link(self, name: str, inertial: dict[str, Any] | None) -> dict[str, Any]:
        link: dict[str, Any] = {"name": name, "inertial": inertial, "shapes": [], "meshes": []}
        self.links.append(link)
        return link

    def _inertial(self, body: int, fraction: float) -> dict[str, Any] | None:
        model = self.model
        if model.body_mass[body] <= 0.0:
            return None
        turn = _matrix(model.body_iquat[body])
        moments = turn @ np.diag(model.body_inertia[body]) @ turn.T
        return {
            "mass": float(model.body_mass[body]) * fraction,
            "position": (model.body_ipos[body] - self.offset[body]).tolist(),
            "inertia": ((moments + moments.T) / 2.0 * fraction).tolist(),
        }

    def _body(self, body: int) -> None:
        """Append a body as links and joints."""
        model, name = self.model, self.names[body]
        joints = list(self._of(body, "jnt"))
        parent = int(model.body_parentid[body])
        at, turn = model.body_pos[body] - self.offset[parent], _matrix(model.body_quat[body])
        frame = {"parent": self.names[parent], "position": at.tolist(), "rpy": rpy_of(turn).tolist()}
        kinds = self.mj.mjtJoint
        if self._free(body):
            if len(joints) > 1:
                self.notes.append(f"{name}: its {len(joints)} joints to the world are taken for a free vehicle's")
            self.joints.append(frame | {"name": self._joint_name(joints[0]), "kind": "floating", "child": name})
            joints = []
        elif not joints:
            self.joints.append(frame | {"name": f"{name}-fixed", "kind": "fixed", "child": name})
        balls = [j for j in joints if model.jnt_type[j] == kinds.mjJNT_BALL]
        for joint in balls:
            self.notes.append(f"{self._joint_name(joint)}: a ball joint, which no scene has: locked")
        joints = [j for j in joints if j not in balls]
        if balls and not joints:
            self.joints.append(frame | {"name": self._joint_name(balls[0]), "kind": "fixed", "child": name})
        for number, joint in enumerate(joints):
            last = number == len(joints) - 1
            child = name if last else f"{name}-carrier-{number + 1}"
            frame = self._joint(body, joint, (frame["parent"], at, turn), child)
            at, turn = np.zeros(3), np.eye(3)
            if not last:
                self._link(child, self._inertial(body, _CARRIER))
        if len(joints) > 1:
            part = f"{_CARRIER * 100.0:g} %"
            text = f"{len(joints)} joints: each but the last carries {part} of the body's mass, as links need mass"
            self.notes.append(f"{name}: {text}")
        fraction = 1.0 - _CARRIER * max(len(joints) - 1, 0)
        self._geometry(body, self._link(name, self._inertial(body, fraction)))

    def _joint(self, body: int, joint: int, frame: tuple[str, Floats, Floats], child: str) -> dict[str, Any]:
        """Append a joint; its child's frame is at its anchor, turned so that coordinates are those of MuJoCo."""
        model, (parent, at, turn) = self.model, frame
        axis, slides = model.jnt_axis[joint], model.jnt_type[joint] == self.mj.mjtJoint.mjJNT_SLIDE
        zero = float(model.qpos0[model.jnt_qposadr[joint]])
        anchor = model.jnt_pos[joint] - self.offset[body]
        position = at + turn @ anchor
        self.offset[body] = model.jnt_pos[joint]
        if slides:
            position = position - turn @ axis * zero
        elif zero != 0.0:
            turn = turn @ about(axis, -zero)
        dof = int(model.jnt_dofadr[joint])
        name = self._joint_name(joint)
        limited = bool(model.jnt_limited[joint])
        kind = "prismatic" if slides else "revolute" if limited else "continuous"
        entry = {
            "name": name,
            "kind": kind,
            "parent": parent,
            "child": child,
            "position": position.tolist(),
            "rpy": rpy_of(turn).tolist(),
            "axis": axis.tolist(),
            "limits": model.jnt_range[joint].tolist() if limited else None,
            "damping": float(np.ravel(model.dof_damping[dof])[0]),
            "friction": float(model.dof_frictionloss[dof]),
            "armature": float(model.dof_armature[dof]),
            "stiffness": float(np.ravel(model.jnt_stiffness[joint])[0]),
            "spring_rest": float(model.qpos_spring[model.jnt_qposadr[joint]]),
        }
        for key, values in (("damping", "dof_dampingpoly"), ("stiffness", "jnt_stiffnesspoly")):
            index = dof if key == "damping" else joint
            if np.any(np.ravel(getattr(model, values, np.zeros((index + 1, 1)))[index])):
                self.notes.append(f"{name}: higher powers of its {key} are left out")
        self.joints.append(entry)
        return entry | {"parent": child}

    def _geometry(self, body: int, link: dict[str, Any]) -> None:
        """Shapes and meshes: those that collide, else those that are seen."""
        from uvms_gym._importing.mjcf_geometry import drawings, geometry

        model = self.model
        geoms = self._of(body, "geom")
        colliding = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
        for geom in colliding or geoms:
            geometry(model, geom, self.offset[body], link, self.notes)
        seen = [g for g in geoms if g not in colliding] or geoms
        link["meshes"] += drawings(model, seen, self.offset[body])
        fluid = [g for g in geoms if model.geom_fluid[g, 0] > 0.0]
        if fluid:
            count = f"{len(fluid)} geom{'s' * (len(fluid) > 1)}"
            self.notes.append(f"{self.names[body]}: fluidshape of {count} is left out: what water does is estimated")
        if model.body_gravcomp[body] != 0.0:
            text = f"gravcomp {model.body_gravcomp[body]:g} is left out: buoyancy follows from the volume"
            self.notes.append(f"{self.names[body]}: {text}")

    def robot(self) -> dict[str, Any]:
        """The robot, with the effects of actuators and equalities."""
        from uvms_gym._importing.mjcf_actuators import actuators, couplings

        by_name = {joint["name"]: joint for joint in self.joints}
        thrusters, used = actuators(self, by_name)
        couplings(self, by_name)
        self._sites(used)
        model = self.model
        if model.ntendon:
            self.notes.append(f"{model.ntendon} tendon{'s' * (model.ntendon > 1)}: left out, scenes have none")
        density = float(model.opt.density)
        water = _WATER[0] <= density <= _WATER[1]
        if density > 0.0 and not water:
            self.notes.append(f'<option density="{density:g}">: no water: left out')
        return {
            "name": model.names.split(b"\0")[0].decode(errors="replace"),
            "source": self.path,
            "format": "MJCF",
            "fluid_density": density if water else None,
            "notes": list(dict.fromkeys(self.notes)),
            "links": self._without_world(),
            "joints": self.joints,
            "thrusters": thrusters,
        }

    def _without_world(self) -> list[dict[str, Any]]:
        """All links; the world only where several trees, or a free body, hang on it."""
        on_world = [joint for joint in self.joints if joint["parent"] == _WORLD]
        if len(on_world) == 1 and on_world[0]["kind"] == "fixed":
            self.joints.remove(on_world[0])
            return self.links[1:]
        return self.links

    def _sites(self, used: set[int]) -> None:
        """Sites as frames on fixed joints: an end effector may be named there."""
        model = self.model
        for site in (i for i in range(model.nsite) if i not in used and model.site_bodyid[i] in self.kept):
            name, body = self._name("SITE", site), int(model.site_bodyid[site])
            if not name:
                continue
            name = self._unique(name, self.taken)
            self._link(name, None)
            frame = {"parent": self.names[body], "position": (model.site_pos[site] - self.offset[body]).tolist()}
            frame["rpy"] = rpy_of(_matrix(model.site_quat[site])).tolist()
            self.joints.append(frame | {"name": f"{name}-site", "kind": "fixed", "child": name})


def _matrix(quaternion: Floats) -> Floats:
    return matrices(np.asarray(quaternion, dtype=np.float64))


def _sentence(error: Exception) -> str:
    """An error of MuJoCo in one line."""
    text = re.sub(r"\s*\n\s*", ", ", str(error).strip())
    return re.sub(r"^(XML )?(Error: )+", "", text)


def main(path: str, seconds: str, memory: str) -> dict[str, Any] | str:
    """The robot, or the reason why there is none."""
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds)))
    resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    try:
        import mujoco
    except ModuleNotFoundError:
        return "MJCF needs mujoco; run: pip install 'uvms-gym[import]'"
    # MuJoCo appends warnings to a file in the working folder by default.
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        model, notes = _compile(path)
        return _Reader(model, path, notes).robot()
    except _Refused as error:
        return str(error)
    except MemoryError:
        return f"takes more than {int(memory) / 1e9:g} GB to read: it may stand for very many bodies"
    except Exception as error:  # whatever MuJoCo raises for a broken file
        return _sentence(error)


if __name__ == "__main__":
    print(json.dumps(main(*sys.argv[1:])))
