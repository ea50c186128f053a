__version__: str

class SceneError(ValueError):
    """A scene that cannot be read, or that no physical system can have."""
