"""Small posed scenes and random-initialised networks that several folders of tests share."""

import json
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from torch import Tensor

from fecocodec.checkpoint import RECEIVER_FILE, SENDER_FILE, model_id_of
from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.geometry.cameras import Cameras, camera_to_world_points, pixel_rays
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.geometry.views import Views
from fecocodec.photographs.images import write_image
from fecocodec.receiver.model import Receiver, serialise_receiver
from fecocodec.sender.codec import serialise_sender
from fecocodec.sender.extractors.protocol import Extractor
from fecocodec.sender.model import Sender
from fecocodec.training.synthetic.scenes import SyntheticScenes
from fecocodec.training.synthetic.textures import pattern_textures

MODEL = "random"


def example_cameras(num_views: int, seed: int = 0, near: float = 1.5, far: float = 12.0) -> Cameras:
    """Cameras about half a unit apart, turned by a few degrees, anywhere in the world."""
    generator = torch.Generator().manual_seed(seed)
    turns = 0.05 * torch.randn(num_views, 3, generator=generator)
    world = Rotation.from_rotvec(torch.randn(3, generator=generator).numpy())
    extrinsics = torch.eye(4).repeat(num_views, 1, 1)
    extrinsics[:, :3, :3] = torch.from_numpy((world * Rotation.from_rotvec(turns.numpy())).as_matrix()).float()
    extrinsics[:, :3, 3] = 0.4 * torch.randn(num_views, 3, generator=generator) + 3.0
    intrinsics = torch.tensor([[0.9, 0.0, 0.52], [0.0, 1.1, 0.47], [0.0, 0.0, 1.0]]).repeat(num_views, 1, 1)
    return Cameras(extrinsics, intrinsics, torch.tensor(near), torch.tensor(far))


def cameras_in_a_row(
    *positions: float, axis: int = 0, focal: tuple[float, float] = (1.0, 1.0), near: float = 1.0, far: float = 20.0
) -> Cameras:
    """Cameras that look along z, at these coordinates of one axis. focal: fx and fy in image sides."""
    extrinsics = torch.eye(4).repeat(len(positions), 1, 1)
    extrinsics[:, axis, 3] = torch.tensor(positions)
    intrinsics = torch.tensor([[focal[0], 0.0, 0.5], [0.0, focal[1], 0.5], [0.0, 0.0, 1.0]])
    return Cameras(extrinsics, intrinsics.repeat(len(positions), 1, 1), torch.tensor(near), torch.tensor(far))


def surface(cameras: Cameras, depth: Float[Tensor, "view h w"], colour: Tensor, opacity: float) -> Gaussians:
    """One Gaussian a pixel on the surfaces of each view, in the order of the predictor. colour: sRGB [view h w 3]."""
    rays = pixel_rays(cameras, *depth.shape[1:])
    means = camera_to_world_points(cameras, rays * depth[..., None]).reshape(-1, 3)
    return Gaussians(
        means=means,
        scales=(0.6 / depth.shape[1] * depth.reshape(-1, 1)).expand(-1, 3),
        rotations=torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(len(means), 1),
        opacities=torch.full((len(means),), opacity),
        harmonics=((colour - 0.5) / SH_DEGREE_0).reshape(-1, 1, 3),
    )


def example_views(num_views: int, height: int = 64, width: int = 64, seed: int = 0) -> Views:
    """Images of smooth colours with some grain; they show no consistent scene, which a codec must bear."""
    generator = torch.Generator().manual_seed(seed)
    smooth = F.interpolate(torch.rand(num_views, 3, 6, 6, generator=generator), (height, width), mode="bilinear")
    images = (smooth + 0.1 * torch.randn(num_views, 3, height, width, generator=generator)).clamp(0, 1)
    return Views(images, example_cameras(num_views, seed), tuple(f"view {view}" for view in range(num_views)))


def synthetic_views(num_context: int, num_target: int, size: tuple[int, int] = (64, 96), seed: int = 11) -> Views:
    """Views of a synthetic scene, which show one room."""
    world, generator = SyntheticScenes(pattern_textures(8)), torch.Generator().manual_seed(seed)
    return world.sample(generator, num_context=num_context, num_target=num_target, size=size).views


def write_scene(folder: Path, seed: int = 0, num_views: int = 2) -> None:
    """Write `example_views` of 64x64 pixels as PNG, with a transforms.json."""
    write_views(folder, example_views(num_views, seed=seed))


def write_views(folder: Path, views: Views) -> None:
    """Write views as PNG, with a transforms.json. Their cameras have the intrinsics of the first."""
    folder.mkdir(parents=True, exist_ok=True)
    frames = []
    for view, image in enumerate(views.images):
        write_image(folder / f"{view}.png", image)
        pose = views.cameras.extrinsics[view].clone()
        pose[:, 1:3] *= -1  # OpenCV to OpenGL axes
        frames.append({"file_path": f"{view}.png", "transform_matrix": pose.tolist()})
    (height, width), matrix = views.image_size, views.cameras.intrinsics[0].double()
    lens = {"w": width, "h": height, "fl_x": float(matrix[0, 0]) * width, "fl_y": float(matrix[1, 1]) * height}
    bounds = {"near": float(views.cameras.near), "far": float(views.cameras.far)}
    (folder / "transforms.json").write_text(json.dumps({**lens, **bounds, "frames": frames}))


def write_random_model(weights: Path) -> None:
    """Weights files of untrained networks below `weights`; their latents are wide enough for many nonzero symbols."""
    torch.manual_seed(0)
    receiver = Receiver(ReceiverConfig())
    sender = Sender(SenderConfig(), receiver.config)
    with torch.no_grad():
        receiver.predictor.depth_head.weight.mul_(20.0)
        receiver.predictor.head.get_parameter("2.weight").mul_(20.0)
    folder = weights / MODEL
    folder.mkdir(parents=True)
    receiver_bytes = serialise_receiver(receiver)
    (folder / RECEIVER_FILE).write_bytes(receiver_bytes)
    (folder / SENDER_FILE).write_bytes(serialise_sender(sender, model_id_of(receiver_bytes)))


def fused(extractor: Extractor, images: torch.Tensor, cameras: Cameras) -> torch.Tensor:
    """Return F1 of an extractor."""
    return extractor.fuse(images, extractor.match(images, cameras))
