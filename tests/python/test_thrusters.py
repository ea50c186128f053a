"""Bench tables of thrusters in Python, supply voltages of scenes, and batteries."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import uvms_gym
from uvms_gym import pulse_of, thrust_of

TABLE = Path(__file__).parents[2] / "src" / "description" / "t200.csv"
VOLTAGES = np.arange(10.0, 21.0, 2.0)


def test_the_makers_table_and_its_inverse() -> None:
    rows = np.loadtxt(TABLE, delimiter=",", skiprows=2)
    pulses, bench = rows[:, 0], rows[:, 1:]
    for voltage, column in zip(VOLTAGES, bench.T, strict=True):
        given = thrust_of(pulses, "t200", voltage)
        np.testing.assert_allclose(given, column, atol=1e-12)
        live = column != 0.0
        np.testing.assert_allclose(pulse_of(given, "t200", voltage)[live], pulses[live], atol=1e-6)
        assert (pulse_of(given, "t200", voltage)[~live] == 1500.0).all()
    # A voltage of each pulse; 16 V by default.
    np.testing.assert_array_equal(
        thrust_of(np.tile(pulses, (6, 1)).T, voltage=np.tile(VOLTAGES, (41, 1))), bench.round(12)
    )
    assert thrust_of(1900.0) == 51.44 and thrust_of(1900.0).shape == () and thrust_of([]).shape == (0,)
    # No signal; full thrust from the table's end on; what no thruster gives.
    np.testing.assert_array_equal(thrust_of([0.0, 1500.0, 1950.0, 1000.0]), [0.0, 0.0, 51.44, -39.91])
    np.testing.assert_array_equal(pulse_of([99.0, -99.0, 0.0]), [1900.0, 1100.0, 1500.0])


def test_own_tables_and_what_is_refused() -> None:
    own = {"pulses": [1000, 1500, 2000], "voltages": np.array([12.0, 24.0]), "thrusts": [[-50, -99], [0, 0], [50, 99]]}
    np.testing.assert_allclose(thrust_of([1250, 2000], own, [12.0, 18.0]), [-25.0, 74.5])
    np.testing.assert_allclose(pulse_of([-25.0, 74.5], own, [12.0, 18.0]), [1250, 2000])
    wrong: list[tuple[Any, ...]] = [
        (([1500.0], "t200", 9.5), r"voltage is 9\.5, but the table has 10\.0 to 20\.0 V"),
        (([1500.0, 1.0], "t200", [16.0, 21.0]), r"voltage\[1\] is 21\.0, but"),
        (([1500.0, 0.5],), r"pulse\[1\] is 0\.5, but must be 0 or 1000\.0 to 2000\.0 us"),
        ((float("nan"),), r"pulse is NaN, but must be 0 or"),
        ((1500.0, "T500"), r"map: no map is named \"T500\": expected \"t200\""),
        ((1500.0, {"pulses": [], "voltages": [], "thrusts": []}), r"map: has 0 pulses, but must have 2 to 64"),
        ((1500.0, {"pulses": [1, 2]}), r"map: expected \"t200\", a table of pulses, voltages and thrusts"),
        (([1500.0] * 3, "t200", [16.0, 16.0]), r"voltage has shape \(2,\), but must have \(\) or the shape of pulse"),
    ]
    for arguments, message in wrong:
        with pytest.raises(ValueError, match=f"^{message}") as error:
            thrust_of(*arguments)
        assert "\n" not in str(error.value)
    with pytest.raises(ValueError, match=r"^thrust\[1\] is inf, but must be finite$"):
        pulse_of([0.0, float("inf")])
    with pytest.raises(TypeError, match="map must be a name or a dict of a table, not list"):
        thrust_of(1500.0, [[0, 0], [1, 1]])  # type: ignore[arg-type]


def scene_of(voltage: float | None = None) -> dict[str, Any]:
    scene = uvms_gym.load_scene("bluerov2-heavy")
    for thruster in scene["vehicle"]["thrusters"]:
        thruster["map"] = "t200"
    if voltage is not None:
        scene["vehicle"]["voltage"] = voltage
    return scene


def settled(scene: dict[str, Any]) -> np.ndarray:
    simulator = uvms_gym.Simulator(scene)
    simulator.step(thrust=np.full(8, 51.4), substeps=1)
    return simulator.thrust[0]


def test_the_voltage_of_a_scene_counts_and_may_be_drawn() -> None:
    full = [thrust_of(1900.0, voltage=voltage) for voltage in VOLTAGES]
    found = [settled(scene_of(voltage))[0] for voltage in VOLTAGES]
    np.testing.assert_allclose(found, np.minimum(full, 51.4))
    np.testing.assert_array_equal(settled(scene_of()), settled(scene_of(16.0)))
    envs = gym.make_vec(
        "UVMS-StationKeep-v0", num_envs=32, scene=scene_of(16.0), action="thrusters",
        randomize={"vehicle.voltage": [10.0, 16.0]}, disturbance="calm",
    )  # fmt: skip
    envs.reset(seed=0)
    envs.step(np.ones((32, 8), dtype=np.float32))
    thrusts = envs.unwrapped.snapshot().thrust[:, 0]  # type: ignore[attr-defined]
    assert 28.6 < thrusts.min() < 32.0 and 48.0 < thrusts.max() < 51.5
    with pytest.raises(uvms_gym.SceneError, match=r"vehicle\.voltage: is 24\.0 V, but the bench table"):
        uvms_gym.load_scene(scene_of(24.0))


@pytest.mark.parametrize("dynamics", [False, True])
def test_a_battery_sags_with_the_load(dynamics: bool) -> None:
    scene = scene_of() if dynamics else uvms_gym.load_scene("bluerov2-heavy")
    battery = {"charge": 1.0, "drain": 0.0, "sag": 0.3}

    def gain(action: float, **options: Any) -> float:
        env = gym.make(
            "UVMS-StationKeep-v0", scene=scene, action="thrusters", disturbance={"battery": battery | options}
        )
        env.reset(seed=0)
        info = env.step(np.full(8, action, dtype=np.float32))[-1]
        return float(info["thruster_gain"])

    assert gain(0.0) == 1.0
    for light, heavy in pairwise([0.0, 0.3, 0.6, 1.0]):
        assert gain(heavy) < gain(light)
    assert gain(1.0) == pytest.approx(0.7**1.25, rel=1e-5)
    assert gain(1.0, charge=0.9, sag=0.0) == pytest.approx(0.9**1.25, rel=1e-5)
