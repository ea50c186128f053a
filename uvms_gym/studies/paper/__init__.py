"""Results of Han and Chung, "Dynamic Simulation of UVMS Using Principle of Dynamical Balance", reproduced.

`free_body` (Table 1 and fig. 2), `momentum` (conservation), `arm_motion` (figs. 5 to 7) and `plots`.
"""
