"""Generate the images, depth and transforms.json of this folder from the stereo pair of scikit-image (see README.md).

Needs scikit-image in addition to the dependencies of the project: `python make_example.py`.
"""

import json
import tempfile
from pathlib import Path

import numpy as np
import skimage.data
import torch
from PIL import Image

from fecocodec.captures.scene_folder import read_views
from fecocodec.geometry.depth_bounds import bounds_of_depths
from fecocodec.geometry.views import Views
from fecocodec.photographs.images import write_image

SIZE = (256, 384)  # height, width in pixels
REDUCTION = 4  # the pair of scikit-image is the original pair, downscaled by this factor
# The original calibration (calib.txt of the Motorcycle scene) in pixels, with pixel centres at integers.
FOCAL_LENGTH, CENTRE_X, CENTRE_Y, CENTRE_X_SHIFT = 3979.911, 1244.772, 1019.507, 124.343
BASELINE = 0.193001  # metres
DEPTH_FILE = "left_depth.png"  # 16 bits: millimetres along the optical axis of the left camera, 0 without ground truth


def main() -> None:
    folder = Path(__file__).parent
    left, right, disparity = skimage.data.stereo_motorcycle()
    depth = FOCAL_LENGTH / REDUCTION * BASELINE / (disparity + CENTRE_X_SHIFT / REDUCTION)
    bounds = bounds_of_depths(depth[np.isfinite(disparity)])
    assert bounds is not None
    near, far = bounds
    with tempfile.TemporaryDirectory() as name:
        original = Path(name)
        for image, file_name in ((left, "left.png"), (right, "right.png")):
            write_image(original / file_name, _tensor(image.transpose(2, 0, 1) / 255))
        (original / "transforms.json").write_text(json.dumps(_original_cameras(near, far)))
        views = read_views(original, size=SIZE)
    for image, file_name in zip(views.images, views.names, strict=True):
        write_image(folder / "images" / file_name, image, overwrite=True)
    (folder / "transforms.json").write_text(json.dumps(_reduced_cameras(views), indent=1) + "\n")
    millimetres = np.where(np.isfinite(disparity), 1000 * depth, 0)
    Image.fromarray(_at_reduced_pixels(millimetres, views).round().astype(np.uint16)).save(folder / DEPTH_FILE)


def _original_cameras(near: float, far: float) -> dict:
    """Return the cameras of the pair. They are parallel; the right one is one baseline to the right of the left one."""
    frames = []
    for file_name, x, centre_x in (("left.png", 0, CENTRE_X), ("right.png", BASELINE, CENTRE_X + CENTRE_X_SHIFT)):
        pose = np.eye(4)
        pose[0, 3] = x
        pose[:, 1:3] *= -1  # OpenCV axes to the OpenGL axes of the file
        frames.append(
            {
                "file_path": file_name,
                "fl_x": FOCAL_LENGTH / REDUCTION,
                "fl_y": FOCAL_LENGTH / REDUCTION,
                "cx": (centre_x + 0.5) / REDUCTION,
                "cy": (CENTRE_Y + 0.5) / REDUCTION,
                "transform_matrix": pose.tolist(),
            }
        )
    return {"near": near, "far": far, "frames": frames}


def _at_reduced_pixels(depth: np.ndarray, views: Views) -> np.ndarray:
    """Sample a map of the original left image at the pixel centres of the downscaled one, by nearest neighbour."""
    height, width = views.image_size
    intrinsics = views.cameras.intrinsics_px(height, width)[0].double().numpy()
    scale = FOCAL_LENGTH / REDUCTION / np.array([intrinsics[0, 0], intrinsics[1, 1]])
    columns = (np.arange(width) + 0.5 - intrinsics[0, 2]) * scale[0] + (CENTRE_X + 0.5) / REDUCTION
    rows = (np.arange(height) + 0.5 - intrinsics[1, 2]) * scale[1] + (CENTRE_Y + 0.5) / REDUCTION
    return depth[np.floor(rows).astype(int)[:, None], np.floor(columns).astype(int)]


def _reduced_cameras(views: Views) -> dict:
    height, width = views.image_size
    frames = []
    intrinsics = views.cameras.intrinsics_px(height, width).double()
    for name, matrix, extrinsics in zip(views.names, intrinsics, views.cameras.extrinsics, strict=True):
        pose = extrinsics.double()
        pose[:, 1:3] *= -1
        fl_x, fl_y, cx, cy = (round(matrix[at].item(), 4) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
        frames.append({"file_path": f"images/{name}", "fl_x": fl_x, "fl_y": fl_y, "cx": cx, "cy": cy})
        frames[-1]["transform_matrix"] = [[round(value, 6) + 0.0 for value in row] for row in pose.tolist()]
    bounds = {"near": round(views.cameras.near.item(), 3), "far": round(views.cameras.far.item(), 3)}
    return {"camera_model": "PINHOLE", "w": width, "h": height, **bounds, "frames": frames}


def _tensor(array: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32))


if __name__ == "__main__":
    main()
