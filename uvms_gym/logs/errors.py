"""Error of logs and of their maps."""


class LogError(ValueError):
    """Log or map that cannot be read: one line with file, line or key, the value and what is allowed."""
