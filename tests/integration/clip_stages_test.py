"""Stages with value clips show what pxr.Usd shows of them, also after edits of the clips and of what names them."""

import os
import pathlib

import pytest
from stage_following_test import compared

HERE = pathlib.Path(__file__).parent
SEEDS = int(os.environ.get("USDLIVE_CLIP_SEEDS", "60"))
FIRST = int(os.environ.get("USDLIVE_SEED", "0"))
STEPS = 10

# Seeds that found a fault: an instance with clips (10), a clip without samples after one that goes on (2046), samples of another clip (6089).
FOUND = (10, 2046, 6089)


@pytest.mark.parametrize("seed", FOUND)
def test_seeds_of_clips_that_found_a_fault(seed, tmp_path):
    assert compared(HERE / "clip_stages.py", seed, seed + 1, tmp_path) == STEPS + 1


def test_any_edits_of_clips_are_followed(tmp_path):
    count = compared(HERE / "clip_stages.py", FIRST, FIRST + SEEDS, tmp_path, STEPS)
    assert count >= SEEDS * STEPS * 0.9, "only %d steps could be compared" % count
