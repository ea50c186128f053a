"""Contact beside other programs, and added mass as a lagged force where a vehicle touches a wall.

`scenes` has scenes that MuJoCo can compute, too; `peers` runs them in both programs and measures errors and costs;
`lagged_added_mass` sweeps the ratio of added mass to mass; `cost` measures the cost of contact by its number of
spheres; `plots` draws the figures. `python tests/bench/contact.py` runs all.
"""
