"""Moves in words."""

import numpy as np
import pytest

from pipeline.motion.words import in_words


@pytest.mark.parametrize(
    ("step", "words"),
    [
        ((0.5, 0.0, 0.0), "0.50 m forwards"),
        ((-0.5, 0.1, 0.0), "0.51 m backwards"),
        ((0.0, 0.2, 0.0), "0.20 m to the left"),
        ((0.01, -0.2, np.radians(-30)), "0.20 m to the right and 30 deg right"),
        ((0.001, 0.0, np.radians(3)), "3 deg left"),
        ((0.0, 0.0, 0.0), "no move"),
    ],
)
def test_a_move_is_told(step, words):
    assert in_words(np.array(step)) == words
