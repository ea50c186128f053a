"""What the scripts on Ray share: a connection that fails at once and in one line, and quiet."""

import logging
import os
import socket
import sys
from typing import Annotated, Any

# Ray reads these when it is imported: no reports to its makers, and no advice about the environment's variables.
os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")

try:
    import gymnasium
    import ray
    import typer

    import uvms_gym  # noqa: F401 (registers the environments)
    from uvms_gym.cli.common import fail
except ImportError as error:
    print(f"needs {error.name or error}: pip install 'uvms-gym[rllib]'", file=sys.stderr)
    raise SystemExit(2) from None

#: The option that both scripts have.
Address = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Cluster: auto, HOST:PORT or ray://HOST:PORT. [default: Ray on this machine]"),
]
#: How long an address is waited for, s.
PATIENCE = 5.0
#: How often Ray is started on this machine before that is given up.
ATTEMPTS = 3


def connect(address: str | None, **local: Any) -> None:
    """Join the Ray cluster at an address, or start Ray on this machine with the arguments `local`.

    Raises
    ------
    TyperException
        Nobody answers there, or it is another version of Ray.
    """
    where = {"address": address} if address else {"address": "local", "include_dashboard": False, **local}
    if address and address not in ("auto", "local"):
        _knock(address)
    for left in reversed(range(1 if address else ATTEMPTS)):
        try:
            ray.init(**where, log_to_driver=False, logging_level=logging.ERROR)
            break
        # Ray raises bare Exceptions, too: it gives a node 30 s to start, which a busy machine may not.
        except Exception as error:
            ray.shutdown()
            if not left:
                what = f"--address {address}" if address else "Ray does not start"
                raise fail(f"{what}: {str(error).strip().splitlines()[0]}") from None
    for name in ("ray", "ray.rllib"):
        logging.getLogger(name).setLevel(logging.ERROR)


def _knock(address: str) -> None:
    """Check that somebody listens: Ray itself would wait for a minute."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise fail(f"--address is {address!r}, but must be auto, HOST:PORT or ray://HOST:PORT")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=PATIENCE).close()
    except OSError as error:
        raise fail(f"--address {address}: nobody answers ({error.strerror or error})") from None


def check_resources(**wanted: float) -> None:
    """Refuse what Ray would wait for without end.

    Raises
    ------
    TyperException
        The cluster has less of it.
    """
    there = ray.cluster_resources()
    for name, amount in wanted.items():
        if amount > there.get(name, 0):
            raise fail(f"{amount:g} {name}s are needed, but Ray has {there.get(name, 0):g}: ask for less, or --address")


def make_single(env: str, options: dict[str, Any]) -> gymnasium.Env:
    """Make one environment, to ask what it is like.

    Raises
    ------
    TyperException
        There is none of that name here, or the options are wrong.
    """
    try:
        if not str(gymnasium.spec(env).entry_point).startswith("uvms_gym."):
            raise fail(f"{env} is no environment of uvms_gym")
        return gymnasium.make(env, **options)
    except (gymnasium.error.Error, ValueError, TypeError) as error:
        # Gymnasium appends all arguments, whole scenes among them.
        reason = str(error).partition(" was raised from the environment creator")[0]
        raise fail(f"{env}: {reason}") from None


def run(app: typer.Typer, name: str) -> int:
    """Run a script; an error of the user's is one line on stderr. Returns the exit status."""
    try:
        status = app(prog_name=name, standalone_mode=False)
    except typer.TyperException as error:
        print(f"{name}: {' '.join(error.format_message().split())}", file=sys.stderr)
        return error.exit_code
    except (KeyboardInterrupt, typer.Abort):
        print(f"{name}: interrupted", file=sys.stderr)
        return 130
    finally:
        ray.shutdown()
    return status if isinstance(status, int) else 0
