"""Train the policy for any vehicle on drawn vehicles; a stopped run goes on in its folder, also to other `--frames`.

    python training/universal.py --out FOLDER --frames 12000000 --export FILE.safetensors

A run imitates MPC, or begins with the policy `--start`. Reports are ratios to untuned MPC on 16 vehicles that no
training sees: pose error, its 95th percentile, power and variation, as geometric means over the vehicles.
"""

import argparse
import io
import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from uvms_gym._files import write
from uvms_gym.controllers.registry import make_controller
from uvms_gym.studies.comparison.metrics import pose_rms
from uvms_gym.studies.comparison.statistics import interquartile_mean
from uvms_gym.studies.records import circumstances
from uvms_gym.training.export import versions
from uvms_gym.training.fleet import HELD_OUT, TEACHER, DrawnVehicle, Fleet, FleetSettings, quiet
from uvms_gym.training.run import interrupt_event, passed

HELD, METRICS = 16, ("pose", "pose_95", "power", "variation")


def main() -> None:
    """Run from the command line."""
    usual = FleetSettings(frames=12_000_000)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of the run")
    parser.add_argument("--export", type=Path, help="file of the finished policy")
    parser.add_argument("--start", help="policy to begin with, in place of imitation")
    parser.add_argument("--spans", type=int, nargs="+", default=usual.spans, help="observations in each average")
    parser.add_argument("--stop", type=int, help="frames after which to stop, as after Ctrl-C")
    parser.add_argument("--every", type=int, default=2_000_000, help="frames between evaluations and checkpoints")
    for name in ("frames", "seed", "vehicles", "episodes"):
        parser.add_argument(f"--{name}", type=int, default=getattr(usual, name))
    for name in ("effort", "action_rate", "rate"):
        parser.add_argument(f"--{name.replace('_', '-')}", type=float, default=getattr(usual, name))
    given = vars(parser.parse_args())
    out, export, every, stop = (given.pop(name) for name in ("out", "export", "every", "stop"))
    settings = FleetSettings(**{**given, "spans": tuple(given["spans"])})
    torch.set_num_threads(1)
    out.mkdir(parents=True, exist_ok=True)
    run(settings, out, export, every, stop or settings.frames)


def run(settings: FleetSettings, out: Path, export: Path | None, every: int, stop: int) -> None:
    """Train to `stop` frames, with a checkpoint, an evaluation and the policy in `out` every so many frames."""
    config, checkpoint = out / "config.json", out / "checkpoint.pt"
    state = torch.load(checkpoint, weights_only=True) if checkpoint.exists() else None
    given = json.loads(json.dumps(asdict(settings)))
    if state is not None and json.loads(config.read_text()) | {"frames": settings.frames} != given:
        raise SystemExit(f"{config} has other settings than these: give another --out")
    write(config, json.dumps(given, indent=1) + "\n")
    start = settings.start and Path(settings.start).name
    commit = circumstances("universal", {})["commit"]
    begun = time.perf_counter() - (state["seconds"] if state else 0.0)
    used = time.process_time() - (state["processor"] if state else 0.0)

    def say(words: str) -> None:
        print(f"{time.perf_counter() - begun:6.0f} s  {words}", flush=True)

    fleet = Fleet(settings, state)
    held = [DrawnVehicle(HELD_OUT + settings.seed, k, settings, reward={}) for k in range(HELD)]
    with quiet():
        reference = [scores(vehicle, make_controller(TEACHER, vehicle.envs.inner)) for vehicle in held]
    say(f"{settings.vehicles} vehicles")
    if state is None:
        for k, error in enumerate(fleet.imitate()):
            say(f"imitation {k}: {error:.4f}")
    curve: list[dict[str, Any]] = state["curve"] if state else []

    def save() -> None:
        found = np.array([scores(one, fleet.net.network(one.plant, one.envs.inner)) for one in held]) / reference
        means = dict(zip(METRICS, np.exp(np.log(found).mean(axis=0)).tolist(), strict=True))
        curve.append({"frames": fleet.steps, **means, "worst": float(found[:, 0].max())})
        say(", ".join(f"{name} {value:.4g}" for name, value in curve[-1].items()))
        seconds, processor = time.perf_counter() - begun, time.process_time() - used
        data = io.BytesIO()
        torch.save({**fleet.state(), "curve": curve, "seconds": seconds, "processor": processor}, data)
        write(checkpoint, data.getvalue())
        notes = {
            "settings": json.dumps(given | {"start": start}),
            "conditions": json.dumps(fleet.conditions),
            "seed": str(settings.seed),
            "steps": str(fleet.steps),
            "seconds": f"{seconds:.0f}",
            "processor_seconds": f"{processor:.0f}",
            "commit": str(commit),
            "versions": json.dumps(versions()),
            "evaluation": json.dumps(curve[-1]),
        }
        fleet.net.policy(fleet.limits, notes).save(out / "policy.safetensors")

    with interrupt_event() as interrupted:
        if state is None:
            save()
        while fleet.steps < min(stop, settings.frames) and not interrupted.is_set():
            before = fleet.steps
            cost = fleet.iterate()
            if fleet.iteration % 25 == 0:
                say(f"{fleet.steps} frames, cost {cost:.3f}")
            if passed(every, before, fleet.steps) or fleet.left == 0.0:
                save()
        if fleet.left > 0.0:
            save()
            raise SystemExit(130)
    if export is not None:
        write(export, (out / "policy.safetensors").read_bytes())


def scores(vehicle: DrawnVehicle, controller: Any) -> list[float]:
    """`METRICS` of a controller on a vehicle."""
    stats = vehicle.score(controller)
    pose = pose_rms(stats, "station-keep")
    power, variation = (float(stats.mean(name).mean()) for name in ("power", "action_rate"))
    return [interquartile_mean(pose), float(np.quantile(pose, 0.95)), power, variation]


if __name__ == "__main__":
    main()
