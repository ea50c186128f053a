"""Window of pictures, by pygame: extra `view`."""

from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray


class Window:
    """Shows pictures in a window of their size, which opens with the first one.

    Raises
    ------
    gymnasium.error.DependencyNotInstalled
        pygame is not installed.
    """

    def __init__(self, title: str) -> None:
        try:
            import pygame
        except ImportError:
            raise DependencyNotInstalled("pygame is not installed; run: pip install 'uvms-gym[view]'") from None
        self._pygame, self._title = pygame, title
        self._screen: Any = None

    def show(self, picture: NDArray[np.uint8], rate: float) -> None:
        """Show a picture (height, width, 3), at most `rate` of them per second."""
        pygame = self._pygame
        if self._screen is None:
            pygame.display.init()
            pygame.display.set_caption(self._title)
            self._screen = pygame.display.set_mode(picture.shape[1::-1])
            self._clock = pygame.time.Clock()
        self._screen.blit(pygame.surfarray.make_surface(np.swapaxes(picture, 0, 1)), (0, 0))
        pygame.event.pump()
        self._clock.tick(rate)
        pygame.display.flip()

    def close(self) -> None:
        """Close the window."""
        if self._screen is not None:
            self._pygame.display.quit()
            self._screen = None
