"""The command line `uvms`, which needs the extra `cli`."""

import sys
from collections.abc import Sequence
from importlib.util import find_spec


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; `sys.argv` where `arguments` is None. Returns the exit status."""
    missing = [name for name in ("matplotlib", "rich", "scipy", "typer") if find_spec(name) is None]
    if missing:
        print(f"uvms: {', '.join(missing)} not installed; run: pip install 'uvms-gym[cli]'", file=sys.stderr)
        return 1
    from uvms_gym.cli.app import run

    return run(arguments)
