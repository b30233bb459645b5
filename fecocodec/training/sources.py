"""Opening the data sources of a training run."""

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
    """Procedural worlds painted with patterns, the given textures and crops of the photographs; and the photographs.

    photographs: scene folders, or chunks of RealEstate10K, ACID or DL3DV (whose images paint no worlds).
    Raises InputError where a folder holds nothing that can be used, or too few frames for the batches to be drawn.
    """
    if photographs is None and min(configuration.schedule.photograph_share) == 1.0:
        raise InputError("This configuration trains on photographs alone, but there are none; give --photographs.")
    painted = pattern_textures(NUM_PATTERNS)
    if textures is not None:
        painted += textures_from_folder(textures)
    if photographs is None:
        return Sources(ProceduralWorld(painted), None)
    if is_chunk_folder(photographs):
        return Sources(ProceduralWorld(painted), ChunkScenes(photographs))
    scenes = Photographs(photographs)
    most_views = max(count for count, _ in configuration.shapes.view_shares)
    if scenes.most_frames < most_views:
        raise InputError(
            f"{photographs}: no scene has the {most_views} frames that batches may ask for; "
            "add photographs, or train fewer context views (--views 2)."
        )
    painted += textures_from_photographs(photographs, NUM_CROPS)
    return Sources(ProceduralWorld(painted), scenes)
