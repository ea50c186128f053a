"""Tasks: options, argument checks and the native batch; for environments and controllers alike."""
