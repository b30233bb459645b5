"""The codec's networks without coding: latents reach the receiver unrounded, at the smallest lambda."""

import torch

from fecocodec.coding.camera_packing import unpack
from fecocodec.container import Header
from fecocodec.container.header import DIGEST_BYTES
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.views import Views
from fecocodec.receiver.decode import predict_scene
from fecocodec.receiver.view_states import update_views
from fecocodec.sender.encode import Profile
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


@torch.inference_mode()
def uncoded_gaussians(profile: Profile, views: Views) -> Gaussians:
    """What the receiver would decode if both latents arrived as they are: the ceiling of the coded system."""
    receiver, scene = profile.receiver, prepare(profile, views)
    every = tuple(range(scene.num_views))
    matched, lambda_q = match_views(profile, scene), first_stage_lambda_q(FINEST_LAMBDA_Q)
    y = analyse(profile, matched.features, start_state(profile, scene), lambda_q, 1).y
    first = update_views(receiver, None, y, scene.lambda_of_views(lambda_q), 1, every)
    rendering = stage_rendering(profile, scene, first)
    features = feedback_features(profile, scene, matched.depth, rendering, FINEST_LAMBDA_Q)
    y = analyse(profile, features, first.state, FINEST_LAMBDA_Q, 2).y
    second = update_views(receiver, first, y, scene.lambda_of_views(FINEST_LAMBDA_Q), 2, every)
    digests = (bytes(DIGEST_BYTES),) * 2  # of nothing: this header is never written
    header = Header(profile.model_id, scene.num_views, *scene.image_size, FINEST_LAMBDA_Q, digests, every)
    gaussians = predict_scene(receiver, second, unpack(scene.packed), header, None)
    return Gaussians(*(field.clone() for field in gaussians.fields()))
