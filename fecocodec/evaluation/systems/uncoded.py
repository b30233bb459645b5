"""The codec's networks without coding: latents reach the receiver unrounded, at the smallest lambda."""

import torch
from torch import Tensor

from fecocodec.coding.camera_packing import unpack
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import MAX_SH_DEGREE
from fecocodec.receiver.emission import emit
from fecocodec.receiver.state import State
from fecocodec.sender.encode import Profile
from fecocodec.sender.refinement import descend, distortion_of, step_size, steps_of_first
from fecocodec.sender.steps import (
    analyse,
    feedback_features,
    first_stage_lambda_q,
    match_views,
    prepare,
    stage_rendering,
    start_state,
)

FINEST_LAMBDA_Q = 0


@torch.no_grad()
def uncoded_gaussians(profile: Profile, views: Views, refinement_steps: int) -> Gaussians:
    """What the receiver would decode if both latents arrived as they are: the ceiling of the coded system.

    refinement_steps: as the encoder's, towards these views; 0 for what the networks make of them in one pass.
    """
    receiver, scene = profile.receiver, prepare(profile, views)

    def refined(y: Tensor, before: State | None, lambda_q: int, stage: int, num_steps: int) -> State:
        def states(y: Tensor) -> State:
            return receiver.advance(before, y, scene.lambda_of_views(lambda_q), stage)

        length = step_size(profile, lambda_q, stage)
        return states(descend(y, lambda y: distortion_of(profile, scene, states(y)), num_steps, length))

    matched, lambda_q = match_views(profile, scene), first_stage_lambda_q(FINEST_LAMBDA_Q)
    y = analyse(profile, matched.features, start_state(profile, scene), lambda_q, 1).y
    first = refined(y, None, lambda_q, 1, steps_of_first(refinement_steps))
    rendering = stage_rendering(profile, scene, first)
    features = feedback_features(profile, scene, matched.depth, rendering, FINEST_LAMBDA_Q)
    y = analyse(profile, features, first.state, FINEST_LAMBDA_Q, 2).y
    second = refined(y, first, FINEST_LAMBDA_Q, 2, refinement_steps)
    return emit(receiver, second, unpack(scene.packed), None, MAX_SH_DEGREE)
