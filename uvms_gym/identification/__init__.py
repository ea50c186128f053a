"""Identification: scenes validated with logs, and fitted to them."""

from uvms_gym.identification.files import ranges
from uvms_gym.identification.fit import Fit, fit
from uvms_gym.identification.validation import Table, Validation, validate

__all__ = ["Fit", "Table", "Validation", "fit", "ranges", "validate"]
