"""Settings of the tests."""

from hypothesis import HealthCheck, settings

# Machines that share their cores are slow now and then; the same examples every time.
settings.register_profile("tests", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("tests")
