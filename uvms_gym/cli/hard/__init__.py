"""Hard cases: what a simulator of this kind gets wrong first, each with a truth of its own.

No case may end in a state that is not finite, or in a wrong number, without a word: it meets its bar, or a
`uvms_gym.StepWarning` says so before or as it fails.
"""

from uvms_gym.cli.hard import arms, contact, spinning, water
from uvms_gym.cli.hard.case import Case

CASES: tuple[Case, ...] = (*spinning.CASES, *water.CASES, *arms.CASES, *contact.CASES)

__all__ = ["CASES", "Case"]
