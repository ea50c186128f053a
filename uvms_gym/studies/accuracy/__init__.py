"""Accuracy study: error against cost of integrators, recommended steps, conservation.

`driven_motion` (the motion), `work_precision` (errors and costs), `conservation` (drift without dissipation), `study`
(all of these for a scene, and acceptance criteria), `plots`; `episodes` and `certificate` (errors over an environment's
own episodes).
"""
