"""Hard cases: motions in which simulators of this kind fail first, each with an exact or converged reference.

Every run either meets its error bound or emits a `uvms_gym.StepWarning` before or as it fails. `case` defines cases,
runs and errors; `spinning`, `water`, `arms`, `contact`, `touch`, `secular`, `oscillations`, `accumulation`
and `rotors` contain the cases; `reference_solutions` has closed forms; `study` runs all, and `plots` draws them.
"""

from uvms_gym.studies.hard_cases import (
    accumulation,
    arms,
    contact,
    oscillations,
    rotors,
    secular,
    spinning,
    touch,
    water,
)
from uvms_gym.studies.hard_cases.case import Case

CASES: tuple[Case, ...] = (
    *spinning.CASES,
    *water.CASES,
    *arms.CASES,
    *contact.CASES,
    *touch.CASES,
    *secular.CASES,
    *oscillations.CASES,
    *accumulation.CASES,
    *rotors.CASES,
)

__all__ = ["CASES", "Case"]
