"""Studies of the simulator and of controllers, as plain functions that return data.

`accuracy` (error against cost of integrators), `hard_cases` (accuracy where simulators fail first), `speed` (steps per
second, MuJoCo and Pinocchio beside), `comparison` (controllers over paired episodes), `paper` (the results of Han and
Chung) and `terms` (cost and effect of each modelled term); each command of the `uvms` command line prints one of them.
`contact` (MuJoCo beside, added mass as a lagged force, costs) is printed by `tests/bench/contact.py`.

Functions raise ValueError for arguments that cannot be studied. NumPy and Gymnasium suffice, with these exceptions,
each imported when it is called: plots need matplotlib, the hard cases SciPy, the peers MuJoCo and Pinocchio, `contact`
MuJoCo, the learning study Stable-Baselines3.
"""
