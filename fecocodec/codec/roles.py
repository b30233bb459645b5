"""Which photographs of a folder are coded, which guide, and which are only measured; from cameras and headers alone.

Context views are coded. Guides are not coded: the sender learns from them. Checks are left out of everything, and the
decoded file is measured at them: their PSNR is that of new views.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from fecocodec.camera_files.posed_photographs import (
    PosedPhotograph,
    PosedPhotographs,
    distinct_names,
    require_float32_range,
    require_usable,
    rigid_pose,
    stored_lens,
)
from fecocodec.captures.reading_notes import omission_notes, passed_over_notes, without_copies
from fecocodec.captures.view_choice import choose_views, is_usable, no_view, view_indices
from fecocodec.captures.view_selection import All, Guides, Selection, Spread
from fecocodec.captures.view_spread import (
    k_centres,
    overlapping_views,
    overlaps_among,
    require_count,
    spare_for_checks,
    spread_over,
    spread_views,
    with_neighbours,
    within_reach,
)
from fecocodec.codec.guide_choice import COPY, NO_GUIDES, NOT_NAMED, chosen_guides, reasons
from fecocodec.codec.options import EncodingOptions
from fecocodec.errors import InputError, error_context
from fecocodec.limits import MAX_VIEWS
from fecocodec.photographs.framing import MIN_KEPT_AREA, kept_share
from fecocodec.photographs.lens import Lens

MAX_CHECKS = 8
LEAST_FOR_CHECKS = 6  # photographs, of which one is left out to measure
PHOTOGRAPHS_OF_CHECK = 10
LEAST_FOR_CHOICE = 5  # photographs; of fewer, all are coded


@dataclass(frozen=True)
class Roles:
    """Indices of the photographs of a scene by what they are for, in ascending order unless they were named.

    unused: photographs that have none of these roles, by the reason for it. omissions: sentences on photographs that
    cannot be used. warnings: the same for frames without an image or a usable camera.
    """

    context: list[int]
    guides: list[int]
    checks: list[int]
    unused: dict[str, list[int]] = field(default_factory=dict)
    omissions: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


Decide = Callable[[list[int], list[int]], list[int]]
"""(candidates in the order in which they would be coded, photographs that can guide) -> those that are coded."""


def choose_roles(scene: PosedPhotographs, folder: Path, options: EncodingOptions, decide: Decide) -> Roles:
    """Return the roles of the photographs of a scene. Frames without an image or a usable camera have none.

    options: only `views`, `guides`, `num_checks` and `size` count. decide: chooses the coded views of more than four if
    `views` is None or `Auto`.
    Raises InputError for named photographs that do not exist or cannot be used, if none can be used, and for more
    checks or views than there are.
    """
    if options.guides == Spread(0):
        options = replace(options, guides=())
    photographs = scene.photographs
    named, taught = _named(photographs, folder, options.views, options.guides)
    available = [index for index, photograph in enumerate(photographs) if is_usable(photograph)]
    if not available:
        raise no_view(scene)
    passed_over = passed_over_notes(scene, [photographs[index] for index in available])
    chosen = [*named, *taught]
    order = [*chosen, *(index for index in available if index not in chosen)]
    kept, copies = without_copies([photographs[index] for index in order])
    own = {id(photograph) for photograph in kept}
    available = [index for index in available if index in chosen or id(photographs[index]) in own]
    found = _roles(scene, folder, available, named, taught, options, decide)
    if named:
        left_out = [index for index in order if index not in available]
        return replace(found, unused={**found.unused, COPY: left_out}) if left_out else found
    return replace(found, warnings=(*passed_over, *copies))


def _roles(
    scene: PosedPhotographs,
    folder: Path,
    available: list[int],
    named: list[int],
    taught: list[int],
    options: EncodingOptions,
    decide: Decide,
) -> Roles:
    """Return the roles of the available photographs. Other arguments and errors as for `choose_roles`.

    named, taught: those that are named to be coded, and to guide.
    """
    views, guides, num_checks = options.views, options.guides, options.num_checks
    photographs, count = scene.photographs, len(available)
    if isinstance(views, Spread):
        with error_context(folder):
            require_count(views.count, count)
    if not isinstance(guides, tuple) and views is None and count < LEAST_FOR_CHOICE:
        guides = ()
    rest = [index for index in available if index not in {*named, *taught}]
    wanted = default_checks(count) if num_checks is None else num_checks
    if named and wanted == 0 and (guides == () or taught):
        return Roles(named, taught, [], {NOT_NAMED if taught else NO_GUIDES: rest} if rest else {})

    pinholes, problems = usable_cameras(photographs, rest)
    if not pinholes and not named:
        nothing_left = f"{folder}: no photograph is left to be coded; name fewer in `guides`."
        raise InputError(next(iter(problems.values()), nothing_left))
    names = distinct_names([photograph.path for photograph in photographs])
    usable, omissions = list(pinholes), omission_notes(photographs, names, problems)
    if isinstance(views, All):
        choose_views([photographs[index] for index in usable], tuple(range(len(usable))), folder)
        return Roles(usable, [], [], {}, omissions)
    if wanted == 0 and guides == ():
        context = _unguided(scene, folder, views, usable, decide)
        unused = [index for index in usable if index not in context]
        return Roles(context, [], [], {NO_GUIDES: unused} if unused else {}, omissions)
    overlap, baseline = near, _ = overlaps_among(scene, [*named, *taught, *usable])
    spare = spare_for_checks(len(usable), views, num_checks, folder, is_named=bool(named))
    candidates = within_reach(near, usable, named) if named else with_neighbours(near, usable)
    checks = spread_over(near, candidates, min(wanted, spare))
    rest, usable = ([index for index in indices if index not in checks] for indices in (rest, usable))

    if checks and (scene.near is None or scene.far is None):  # then checks would set the bounds of depth
        overlap, baseline = overlaps_among(scene, [*named, *taught, *usable])
    misshapen = set[int]()
    if named:
        context = named
    elif guides == ():
        context = _unguided(scene, folder, views, usable, decide)
    else:
        reached = with_neighbours(overlap, usable) or usable
        shaped = _of_one_shape(pinholes, reached, options.size)
        misshapen = set(usable) - set(_of_one_shape(pinholes, usable, options.size))
        if isinstance(views, Spread):  # of one shape, if they are enough
            enough = shaped if len(shaped) >= views.count else usable
            context = sorted(k_centres(overlap, [], enough, views.count))
        else:
            context = sorted(decide(k_centres(overlap, [], shaped, MAX_VIEWS), [*reached, *taught]))
    if not isinstance(guides, tuple):
        others = [index for index in usable if index not in context]
        taught = chosen_guides(overlap, baseline, context, others, guides)
    checks = within_reach(near, checks, context)
    used = {*context, *taught, *checks, *problems}
    unused = [index for index in available if index not in used]
    by_reason = reasons(overlap, baseline, context, unused, guides, misshapen)
    return Roles(context, taught, checks, by_reason, omissions)


def _named(
    photographs: list[PosedPhotograph], folder: Path, views: Selection | None, guides: Guides
) -> tuple[list[int], list[int]]:
    """Return the named coded photographs and guides. Raises InputError if one does not exist, or is both."""
    named = list[int]()
    if isinstance(views, tuple):
        require_usable(choose_views(photographs, views, folder))
        named = view_indices(photographs, views, folder)
    taught = view_indices(photographs, guides, folder, "guides") if isinstance(guides, tuple) else []
    require_usable([photographs[index] for index in taught])
    for index in set(named) & set(taught):
        name = photographs[index].path.name
        raise InputError(f"{folder}: {name} is to be coded and to guide; name it in `views` or in `guides`.")
    return named, taught


def default_checks(count: int) -> int:
    """Return how many of `count` photographs are left out to measure."""
    return min(MAX_CHECKS, max(1, count // PHOTOGRAPHS_OF_CHECK)) if count >= LEAST_FOR_CHECKS else 0


def _unguided(
    scene: PosedPhotographs, folder: Path, views: Selection | None, rest: list[int], decide: Decide
) -> list[int]:
    """Return what is coded of `rest` where nothing guides: coded views then have to overlap with each other."""
    within = replace(scene, photographs=[scene.photographs[index] for index in rest])
    if isinstance(views, Spread):
        with error_context(folder):
            return [rest[index] for index in spread_views(within, views.count)]
    if views is None and len(rest) < LEAST_FOR_CHOICE:
        return rest
    return sorted(decide([rest[index] for index in overlapping_views(within, MAX_VIEWS)], rest))


def usable_cameras(photographs: list[PosedPhotograph], indices: list[int]) -> tuple[dict[int, Lens], dict[int, str]]:
    """Return the pinholes of the photographs that can be used, and what is wrong with each other one."""
    pinholes, problems = dict[int, Lens](), dict[int, str]()
    for index in indices:
        try:
            pose = rigid_pose(photographs[index].camera_to_world, photographs[index].place)
            require_float32_range(pose[None], photographs[index].place)
            pinholes[index] = stored_lens(photographs[index])[1]
        except InputError as error:
            problems[index] = str(error)
    return pinholes, problems


def _of_one_shape(pinholes: dict[int, Lens], indices: list[int], size: tuple[int, int] | None) -> list[int]:
    """Return the photographs of which a crop to the most frequent size leaves enough; all if a size is given."""
    if size is not None or not indices:
        return indices
    lenses = [pinholes[index] for index in indices]
    common, _ = Counter((lens.height, lens.width) for lens in lenses).most_common(1)[0]
    return [index for index in indices if kept_share(pinholes[index], common) >= MIN_KEPT_AREA]
