"""Curves of thrusters in maps of logs: names, files, and the supply's voltage."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from log_files import write_table

import uvms_gym
from uvms_gym import Log, LogError

T200 = Path(__file__).parents[2] / "src" / "description" / "t200.csv"
PULSES = np.array([1100.0, 1300.0, 1465.0, 1500.0, 1520.0, 1600.0, 1750.0, 1900.0, 0.0])
TABLE = "# a bench\npulse,10V,12V,16 V\n1100,-20,-28,-40\n1480,0,0,0\n\n1520,0,0,0\n1900,30,36,52\n"


def command(folder: Path, axis: dict[str, Any], pulses: np.ndarray = PULSES, volts: Any = None, **keys: Any) -> Any:
    """Commands of a thruster for pulses at 0, 0.1, ... s; a battery's voltages are at 0, 0.4 and 0.8 s."""
    write_table(folder / "out.csv", {"t": 0.1 * np.arange(len(pulses)), "C1": pulses})
    thrusters = {"file": "out.csv", "time": {"column": "t"}, "axes": {"left": {"command": "C1", **axis}}, **keys}
    found: dict[str, Any] = {"thrusters": thrusters}
    if volts is not None:
        write_table(folder / "bat.csv", {"t": 0.4 * np.arange(3), "mV": 1000.0 * np.asarray(volts)})
        voltage = {"columns": ["mV"], "unit": "mV"}
        found["battery"] = {"file": "bat.csv", "time": {"column": "t"}, "voltage": voltage}
    (folder / "map.toml").write_text(_toml(found))
    return Log.read(folder, folder / "map.toml")


def _toml(data: dict[str, Any]) -> str:
    from uvms_gym.identification.files import to_toml

    return to_toml(data)


def test_val_the_named_curve_is_the_makers_table_at_16_volts(tmp_path: Path) -> None:
    pulses = np.array([1100.0, 1200.0, 1400.0, 1480.0, 1520.0, 1600.0, 1700.0, 1800.0, 1900.0, 0.0])
    thrust = command(tmp_path, {"curve": "t200"}, pulses).thrusters.command[:, 0]
    assert np.allclose(thrust, [-39.91, -26.56, -4.72, 0.0, 0.0, 5.92, 17.88, 33.54, 51.44, 0.0], atol=1e-12)


def test_val_the_named_curve_is_the_makers_table_at_the_logged_voltage(tmp_path: Path) -> None:
    rows = {row[0]: row[1:] for row in np.loadtxt(T200, delimiter=",", skiprows=2)}
    pulses = np.array([1100.0, 1300.0, 1600.0, 1900.0, 1600.0, 1600.0, 1600.0, 1600.0, 0.0])
    log = command(tmp_path, {"curve": "t200"}, pulses, volts=[12.0, 16.0, 20.0])
    voltage = log.battery.voltage_at(log.thrusters.time)
    assert voltage.tolist() == pytest.approx([12, 13, 14, 15, 16, 17, 18, 19, 20])
    at = [np.interp(v, np.arange(10.0, 21.0, 2.0), rows[p]) if p else 0.0 for p, v in zip(pulses, voltage)]
    assert np.allclose(log.thrusters.command[:, 0], at, atol=1e-12) and log.thrusters.notes == ()
    assert np.ptp(log.thrusters.command[4:8, 0]) > 0.2
    for volts in (10.0, 13.0, 20.0):
        one = command(tmp_path, {"curve": "t200"}, pulses, voltage=volts).thrusters
        assert np.allclose(one.command[:-1, 0], uvms_gym.thrust_of(pulses[:-1], "t200", volts), atol=1e-12)
    assert command(tmp_path, {"curve": "t200"}, pulses).thrusters.notes == (
        "thrust at 16 V, as the map has neither voltage nor battery",
    )
    with pytest.raises(LogError, match=r"line 2: the supply is 9\.5 V, outside of the curve of left, 10 to 20 V$"):
        command(tmp_path, {"curve": "t200"}, pulses, volts=[9.5, 16.0, 16.0])


def test_val_rows_of_the_table_are_the_makers() -> None:
    """Published rows; between them no cell stands out of its neighbours, as a wrong digit would."""
    voltages = np.arange(10.0, 21.0, 2.0)
    for pulse, row in (
        (1880.0, [27.18, 34.34, 42.21, 49.15, 55.56, 61.34]),
        (1900.0, [28.69, 36.42, 44.36, 51.44, 59.00, 65.92]),
    ):
        assert np.allclose(uvms_gym.thrust_of(np.full(6, pulse), "t200", voltages), row, atol=1e-9)
    pulses = [1200.0, 1300.0, 1400.0, 1600.0, 1700.0, 1800.0]
    twelve = uvms_gym.thrust_of(pulses, "t200", np.full(6, 12.0))
    assert np.allclose(twelve, [-19.1, -10.0, -3.1, 3.9, 12.5, 24.2], atol=0.06)
    grid = np.arange(1100.0, 1901.0, 20.0)
    table = uvms_gym.thrust_of(np.tile(grid[:, None], 6), "t200", np.tile(voltages, (41, 1)))
    assert (np.diff(table, axis=0) >= 0.0).all()
    assert np.abs(np.diff(table, 2, axis=0)).max() < 1.4


def test_the_named_curve_is_the_scenes_map(tmp_path: Path) -> None:
    """A scene with the map gives the same steady thrust for a command that is linear in the pulse."""
    scene = uvms_gym.load_scene("bluerov2-heavy")
    scene["vehicle"]["thrusters"][0] |= {"map": "t200", "lag": 1e-3}
    simulator = uvms_gym.Simulator(scene | {"provenance": {}})
    pulses = np.array([1200.0, 1400.0, 1600.0, 1800.0])
    curve = command(tmp_path, {"curve": "t200"}, pulses).thrusters.command[:, 0]
    for pulse, expected in zip(pulses, curve):
        thrust = np.zeros((1, 8))
        thrust[0, 0] = (pulse - 1500.0) / 400.0 * (51.4 if pulse > 1500.0 else 40.0)
        simulator.reset()
        simulator.step(thrust=thrust, substeps=20)
        assert np.isclose(simulator.thrust[0, 0], expected, rtol=0.0, atol=0.05)


@pytest.mark.parametrize(
    ("voltage", "low", "high"), [(10.0, -20, 30), (11.0, -24, 33), (14.0, -34, 44), (16.0, -40, 52)]
)
def test_a_table_is_read_at_its_voltage(tmp_path: Path, voltage: float, low: float, high: float) -> None:
    (tmp_path / "bench.csv").write_text(TABLE)
    found = command(tmp_path, {"curve": "bench.csv"}, voltage=voltage).thrusters.command[:, 0]
    expected = np.interp(PULSES, [1100, 1480, 1520, 1900], [low, 0, 0, high])
    assert np.allclose(found[:-1], expected[:-1], atol=1e-12) and found[-1] == 0.0


def test_the_maker_publishes_tables_of_this_form(tmp_path: Path) -> None:
    rows = "1880,27.18,34.34,42.21,49.15,55.56,61.34\n1900,28.69,36.42,44.36,51.44,59.00,65.92\n"
    (tmp_path / "t200.csv").write_text("# N by us and V\npulse_us,10V,12V,14V,16V,18V,20V\n1500,0,0,0,0,0,0\n" + rows)
    found = command(tmp_path, {"curve": "t200.csv"}, np.array([1880.0, 1890.0]), voltage=17.0).thrusters.command
    assert np.allclose(found[:, 0], [(49.15 + 55.56) / 2, (49.15 + 55.56 + 51.44 + 59.0) / 4], atol=1e-12)


def test_a_battery_that_sags_weakens_the_thrust(tmp_path: Path) -> None:
    (tmp_path / "bench.csv").write_text(TABLE)
    log = command(tmp_path, {"curve": "bench.csv"}, np.full(9, 1900.0), volts=[16.0, 12.0, 10.0])
    assert np.allclose(log.thrusters.command[:, 0], [52, 48, 44, 40, 36, 34.5, 33, 31.5, 30], atol=1e-12)
    assert log.battery.voltage[:, 0].tolist() == [16.0, 12.0, 10.0] and log.battery.voltage_at([0.2, 9.0]).tolist() == [
        14,
        10,
    ]
    with pytest.raises(LogError, match=r"out\.csv, line 10: the supply is 9\.9 V, outside .* of left, 10 to 16 V$"):
        command(tmp_path, {"curve": "bench.csv"}, np.full(9, 1900.0), volts=[16.0, 12.0, 9.9])


def test_wrong_curves_are_refused(tmp_path: Path) -> None:
    (tmp_path / "bench.csv").write_text(TABLE)
    axis = {"curve": "bench.csv"}
    with pytest.raises(LogError, match=r"thrusters\.voltage: is missing: the curve of left depends on it; also a chan"):
        command(tmp_path, axis)
    with pytest.raises(LogError, match=r"thrusters\.voltage: 18 V is outside of the curve of left, 10 to 16 V$"):
        command(tmp_path, axis, voltage=18.0)
    with pytest.raises(LogError, match=r"line 2: C1 is 1099, outside of the curve of left, 1100 to 1900$"):
        command(tmp_path, axis, np.array([1099.0, 1500.0]), voltage=12.0)
    with pytest.raises(LogError, match=r"curve: 't100' is no list .*, a name, of t200, or a file that ends in \.csv$"):
        command(tmp_path, {"curve": "t100"})
    with pytest.raises(LogError, match=r"other\.csv: no such file$"):
        command(tmp_path, {"curve": "other.csv"})
    for wrong in (
        "",
        "pulse,N\n",
        "pulse,N\n1,2\n1,3\n",
        "a,b\n1,x\n2,3\n",
        "p,16V,12V\n1,2,3\n2,3,4\n",
        "p,N\n1,2,3\n2,3,4\n",
    ):
        (tmp_path / "bench.csv").write_text(wrong)
        with pytest.raises(LogError, match=r'bench\.csv: no curve: a line of names, then lines "command,N" or'):
            command(tmp_path, axis)
    (tmp_path / "bench.csv").write_text("pulse,N\n1100,-40\n1500,0\n1900,50\n")
    assert command(tmp_path, axis).thrusters.command[0, 0] == -40.0
