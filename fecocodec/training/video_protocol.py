"""Choice of the frames of a video as DepthSplat trains, with a gap between the context views that grows with the steps.

Further context views are the farthest points among the camera centres (Xu et al., "DepthSplat", 2025; the sampling
between two frames is that of Charatan et al., "pixelSplat", 2024).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class VideoProtocol:
    """Least and largest number of frames between the first and the last context view.

    first_gaps: at step 0. gaps: from step `curriculum_steps` on; in between, both numbers change linearly.
    """

    gaps: tuple[int, int]
    first_gaps: tuple[int, int]
    curriculum_steps: int

    def gaps_at(self, step: int) -> tuple[int, int]:
        """Return the least and largest gap at a training step."""
        share = min(1.0, step / self.curriculum_steps) if self.curriculum_steps else 1.0
        least, largest = (
            first + int((last - first) * share) for first, last in zip(self.first_gaps, self.gaps, strict=True)
        )
        return least, largest


REALESTATE10K = VideoProtocol(gaps=(45, 135), first_gaps=(25, 45), curriculum_steps=30_000)
DL3DV = VideoProtocol(gaps=(20, 50), first_gaps=(20, 50), curriculum_steps=0)


def choose_farthest_frames(
    rng: np.random.Generator,
    centres: Float[np.ndarray, "frame 3"],
    gaps: tuple[int, int],
    num_context: int,
    num_target: int,
) -> list[int]:
    """Return context frames in order of time, then target frames, drawn uniformly from the stretch, ends included.

    centres: of the cameras. gaps: see `VideoProtocol`; a scene shorter than the least gap is used as a whole. The ends
    of the stretch are context views; each further one is the frame whose centre is farthest from those chosen before.
    """
    longest = min(gaps[1], len(centres) - 1)
    gap = int(rng.integers(min(max(gaps[0], num_context - 1), longest), longest + 1))
    first = int(rng.integers(len(centres) - gap))
    context = [first, first + gap] if num_context > 1 else [first]
    while len(context) < num_context:
        distances = np.linalg.norm(centres[first : first + gap + 1, None] - centres[context], axis=-1).min(axis=1)
        distances[np.array(context) - first] = -1.0
        context.append(first + int(distances.argmax()))
    return [*sorted(context), *rng.integers(first, first + gap + 1, num_target).tolist()]
