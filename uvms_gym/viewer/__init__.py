"""Browser view of an episode, by viser: extra `view`."""
