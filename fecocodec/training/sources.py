"""Data sources of a training run."""

from pathlib import Path

from fecocodec.errors import InputError
from fecocodec.formats.chunks import is_chunk_folder
from fecocodec.training.chunk_scenes import ChunkScenes
from fecocodec.training.configurations import Configuration
from fecocodec.training.dataset import Sources
from fecocodec.training.photographs import Photographs
from fecocodec.training.procedural.scenes import ProceduralWorld
from fecocodec.training.procedural.textures import pattern_textures, textures_from_folder, textures_from_photographs

NUM_PATTERNS, NUM_CROPS = 100, 300


def open_sources(photographs: Path | None, textures: Path | None, configuration: Configuration) -> Sources:
    """Open procedural scenes, textured with patterns, `textures` and crops of the photographs, and the photographs.

    photographs: folder of scene folders, or of chunks of RealEstate10K, ACID or DL3DV (which are not used as textures).
    Raises InputError if a folder has no usable content, or too few frames for the batches of the configuration.
    """
    if photographs is None and min(configuration.schedule.photograph_share) == 1.0:
        raise InputError("This configuration trains on photographs alone, but there are none; give `photographs`.")
    texture_set = pattern_textures(NUM_PATTERNS)
    if textures is not None:
        texture_set += textures_from_folder(textures)
    if photographs is None:
        return Sources(ProceduralWorld(texture_set), None)
    if is_chunk_folder(photographs):
        return Sources(ProceduralWorld(texture_set), ChunkScenes(photographs))
    scenes = Photographs(photographs)
    most_views = max(count for count, _ in configuration.shapes.view_shares)
    if scenes.most_frames < most_views:
        raise InputError(
            f"{photographs}: no scene has the {most_views} frames that batches may ask for; "
            "add photographs, or train fewer context views by `view_shares`."
        )
    texture_set += textures_from_photographs(photographs, NUM_CROPS)
    return Sources(ProceduralWorld(texture_set), scenes)
