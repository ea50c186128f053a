"""Speed study: time per step, environments beside their physics, MuJoCo and Pinocchio, and a learner.

`timing` (interleaved measurement), `physics`, `environment`, `learning`, `peers` (with `mujoco_model`,
`pinocchio_model`, `rigid_bodies`), `equal_error` and `plots`.
"""
