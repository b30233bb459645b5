"""Choose the photographs of a folder by role, and read them."""

from typing import TYPE_CHECKING

from fecocodec.camera_files.posed_photographs import PosedPhotographs
from fecocodec.captures.chosen_photographs import ChosenPhotographs, framed
from fecocodec.captures.reading_notes import scaling_remark, unposed_notes
from fecocodec.captures.view_selection import Spread
from fecocodec.captures.view_spread import too_few
from fecocodec.codec.guide_choice import TOO_FAR, shown_note
from fecocodec.codec.messages import Messages
from fecocodec.codec.options import EncodingOptions
from fecocodec.codec.roles import Roles, choose_roles
from fecocodec.errors import InputError
from fecocodec.photographs.framing import within_limit
from fecocodec.progress import OnProgress

if TYPE_CHECKING:
    from fecocodec.codec.encode_views import Photographs


def read_by_role(
    scene: PosedPhotographs, options: EncodingOptions, messages: Messages, on_progress: OnProgress, most: int
) -> tuple[Roles, "Photographs"]:
    """Choose and read the photographs. most: number of coded views where they are chosen.

    Others replace checks that cannot be read, if none is left, and coded views that are not named.
    """

    shares: dict[int, float] = {}

    def decide(order: list[int], others: list[int]) -> list[int]:
        from fecocodec.codec.view_count import coded_views  # it loads torch

        on_progress("choosing views", 0.0)
        return coded_views(scene, options, shares.update, order[:most], others)

    roles = choose_roles(scene, messages.path, options, decide)
    messages.warn(*roles.warnings)
    for sentence in roles.omissions:
        messages.omit(sentence)
    if isinstance(options.guides, Spread) and len(roles.guides) < options.guides.count:
        messages.note(f"{too_few(options.guides.count, 'guide', len(roles.guides))} can guide.")
    chosen = _framed(scene, roles, options, messages)
    if shares:
        messages.note(shown_note(len(roles.context), shares, roles.unused.get(TOO_FAR, ())))

    from fecocodec.captures.scene_folder import with_problems
    from fecocodec.codec.encode_views import read_photographs
    from fecocodec.sender.optimisation_config import config_of_effort

    config_of_effort(options.effort, options.sharpness)  # raises for one that there is not
    try:
        found = read_photographs(*chosen, options, messages)
    except InputError:
        readable = scene if isinstance(options.views, tuple) else with_problems(scene, roles.context, messages.omit)
        if readable is scene:
            raise
    else:
        readable = with_problems(scene, roles.checks, messages.omit) if found.checks is None else scene
        if readable is scene:
            return roles, found
    return read_by_role(readable, options, messages, on_progress, most)


def _framed(
    scene: PosedPhotographs, roles: Roles, options: EncodingOptions, messages: Messages
) -> tuple[ChosenPhotographs, ChosenPhotographs | None, ChosenPhotographs | None]:
    """Return the coded photographs, guides and checks, cropped to one size. Raises InputError."""

    def of(indices: list[int], size: tuple[int, int] | None) -> ChosenPhotographs:
        return framed(scene, [scene.photographs[index] for index in indices], size, [])

    chosen = of(roles.context, options.size)
    if options.size is None and (size := within_limit(chosen.image_size, len(roles.context))) != chosen.image_size:
        chosen = of(roles.context, size)
    if options.views is None:
        messages.warn(*unposed_notes(scene))
    messages.note(*chosen.remarks)
    messages.warn(*chosen.notes)
    if options.size is None and (remark := scaling_remark(chosen.lenses, chosen.image_size)):
        messages.note(remark)
    guides, checks = (of(part, chosen.image_size) if part else None for part in (roles.guides, roles.checks))
    return chosen, guides, checks
