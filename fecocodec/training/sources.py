"""Data sources of a training run."""

from pathlib import Path

from fecocodec.camera_files.chunks import is_chunk_folder
from fecocodec.config import CodecConfig, PaperSenderConfig
from fecocodec.errors import InputError
from fecocodec.training.augmentation import CROP_SPREAD
from fecocodec.training.chunk_scenes import ChunkScenes
from fecocodec.training.configurations import Configuration
from fecocodec.training.dataset import Sources
from fecocodec.training.photographs import Photographs
from fecocodec.training.procedural.scenes import ProceduralWorld
from fecocodec.training.procedural.textures import pattern_textures, textures_from_folder, textures_from_photographs

NUM_PATTERNS, NUM_CROPS = 100, 300


def open_sources(
    photographs: Path | None, textures: Path | None, configuration: Configuration, validation: Path | None = None
) -> Sources:
    """Open procedural scenes, textured with patterns, `textures` and crops of the photographs, and the photographs.

    photographs: folder of scene folders, or of chunks of RealEstate10K, ACID or DL3DV (which are not used as textures).
    All frames of a scene are cropped alike for an extractor with public geometry. validation: the same kind of folder,
    with other scenes, for measuring during training.
    Raises InputError if a folder has no usable content, or too few frames for the batches of the configuration.
    """
    if photographs is None and min(configuration.schedule.photograph_share) == 1.0:
        raise InputError("This configuration trains on photographs alone, but there are none; give `photographs`.")
    texture_set = pattern_textures(NUM_PATTERNS)
    if textures is not None:
        texture_set += textures_from_folder(textures)
    held_out = None if validation is None else _open_photographs(validation, configuration)
    if photographs is None:
        return Sources(ProceduralWorld(texture_set), None, held_out)
    scenes = _open_photographs(photographs, configuration)
    if isinstance(scenes, Photographs):
        texture_set += textures_from_photographs(photographs, NUM_CROPS)
    return Sources(ProceduralWorld(texture_set), scenes, held_out)


def _open_photographs(folder: Path, configuration: Configuration) -> ChunkScenes | Photographs:
    """Open chunks, or a folder of scene folders. Raises InputError if no scene has the frames of the largest batch."""
    spread = 0.0 if has_public_geometry(configuration.sender) else CROP_SPREAD
    if is_chunk_folder(folder):
        return ChunkScenes(folder, spread, configuration.protocol)
    scenes = Photographs(folder, spread)
    most_views = max(count for count, _ in configuration.shapes.view_shares)
    if scenes.most_frames < most_views:
        raise InputError(
            f"{folder}: no scene has the {most_views} frames that batches may ask for; "
            "add photographs, or train fewer context views by `view_shares`."
        )
    return scenes


def has_public_geometry(config: CodecConfig) -> bool:
    """Return whether the extractor projects all views with the intrinsics of one, as the public code does."""
    return isinstance(config, PaperSenderConfig) and config.geometry == "public"
