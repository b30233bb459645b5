# mypy: disallow-untyped-defs=False
"""Colour of a surface point: filtered texture, shadow, ambient occlusion, diffuse light and highlight.

Vectors are three numbers of a tuple; tables are those of `solids`; colours are linear light.
"""

import math

from fecocodec.kernels.compilation import compiled
from fecocodec.training.synthetic.raycast import intersect, to_unit
from fecocodec.training.synthetic.solids import (
    AMBIENT,
    AREA,
    CENTRE,
    FILL,
    FILL_COLOUR,
    GLOSS,
    GLOW,
    KEY,
    KEY_COLOUR,
    KIND,
    OFFSET,
    PLAIN,
    RADIUS,
    SCALE,
    SHARE,
    SHININESS,
    SOFTNESS,
    TEXTURE,
    TINT,
)
from fecocodec.training.synthetic.textures import TEXTURE_SIDE

_NUM_LEVELS = TEXTURE_SIDE.bit_length()
_LEAST_SKY = 0.02
"""Solids whose bounding sphere covers a smaller share of the sky than this are ignored in ambient occlusion."""


@compiled
def _filtered_texel(texels, texture, level, u, v):
    """Return the bilinear value of a tiling texture at one mip level, in linear light (gamma 2)."""
    side = TEXTURE_SIDE >> level
    start = (4 * (TEXTURE_SIDE * TEXTURE_SIDE - side * side)) // 3
    x = (u - math.floor(u)) * side + (side - 0.5)
    y = (v - math.floor(v)) * side + (side - 0.5)
    left, top = int(x), int(y)
    across, down = x - left, y - top
    mask = side - 1
    red = green = blue = 0.0
    for corner in range(4):
        right, below = corner & 1, corner >> 1
        weight = (across if right else 1.0 - across) * (down if below else 1.0 - down) / (255.0 * 255.0)
        texel = start + ((top + below) & mask) * side + ((left + right) & mask)
        r, g, b = float(texels[texture, texel, 0]), float(texels[texture, texel, 1]), float(texels[texture, texel, 2])
        red, green, blue = red + weight * r * r, green + weight * g * g, blue + weight * b * b
    return red, green, blue


@compiled
def surface_colour(texels, surfaces, surface, chart_u, chart_v, footprint):
    """Colour without light at a texture position in metres. footprint: metres on the surface that a pixel covers."""
    share = surfaces[surface, SHARE]
    if share == 0.0:
        return surfaces[surface, PLAIN], surfaces[surface, PLAIN + 1], surfaces[surface, PLAIN + 2]
    scale_u, scale_v = surfaces[surface, SCALE], surfaces[surface, SCALE + 1]
    u = chart_u * scale_u + surfaces[surface, OFFSET]
    v = chart_v * scale_v + surfaces[surface, OFFSET + 1]
    texture = int(surfaces[surface, TEXTURE])
    covered = footprint * math.sqrt(scale_u * scale_v) * TEXTURE_SIDE
    level = min(math.log2(max(covered, 1.0)), _NUM_LEVELS - 1.001)
    fine = int(level)
    red, green, blue = _filtered_texel(texels, texture, fine, u, v)
    if level > fine:
        coarse = level - fine
        r, g, b = _filtered_texel(texels, texture, fine + 1, u, v)
        red, green, blue = red + coarse * (r - red), green + coarse * (g - green), blue + coarse * (b - blue)
    plain = 1.0 - share
    return (
        share * red * surfaces[surface, TINT] + plain * surfaces[surface, PLAIN],
        share * green * surfaces[surface, TINT + 1] + plain * surfaces[surface, PLAIN + 1],
        share * blue * surfaces[surface, TINT + 2] + plain * surfaces[surface, PLAIN + 2],
    )


@compiled
def visibility_and_openness(solids, own, point, normal, lights):
    """Return (share of the key light that arrives, share of the surroundings that other solids do not cover).

    A shadow deepens with the length of the light ray's chord in a solid, relative to the distance: full in the
    middle, soft at the edge. Openness sums up the solids as spheres (Quilez, "sphere ambient occlusion").
    """
    to_light, distance = direction_to(lights, KEY, point)
    is_lit = _dot(to_light, normal) > 0.0
    softness = lights[SOFTNESS, 0]
    visible, hidden = 1.0, 0.0
    for solid in range(len(solids)):
        x, y, z = (
            solids[solid, CENTRE] - point[0],
            solids[solid, CENTRE + 1] - point[1],
            solids[solid, CENTRE + 2] - point[2],
        )
        squared = x * x + y * y + z * z
        radius = solids[solid, RADIUS]
        if solid != own and radius * radius > _LEAST_SKY * squared:
            facing = x * normal[0] + y * normal[1] + z * normal[2]
            hidden += max(facing, 0.0) * solids[solid, AREA] / (squared * math.sqrt(squared) + 1e-9)
        if is_lit and visible > 0.0:
            along = x * to_light[0] + y * to_light[1] + z * to_light[2]
            if along > -radius and squared - along * along < radius * radius:
                ox, oy, oz = to_unit(solids, solid, -x, -y, -z)
                dx, dy, dz = to_unit(solids, solid, to_light[0], to_light[1], to_light[2])
                start, end = intersect(solids[solid, KIND], ox, oy, oz, dx, dy, dz)
                start, end = max(start, 1e-3 * (1.0 + radius)), min(end, distance)
                visible -= max(end - start, 0.0) / (softness * start + 1e-3 * radius)
    return (max(visible, 0.0) if is_lit else 0.0), 1.0 - min(hidden, 0.75)


@compiled
def lit(surfaces, surface, colour, lights, point, normal, view, visible, openness):
    """Return the light from a surface of this colour towards the viewer: Lambert, with a Blinn-Phong highlight."""
    to_key, _ = direction_to(lights, KEY, point)
    to_fill, _ = direction_to(lights, FILL, point)
    key = max(_dot(to_key, normal), 0.0) * visible
    fill = max(_dot(to_fill, normal), 0.0) * openness
    shine = 0.0
    if surfaces[surface, GLOSS] > 0.0 and key > 0.0:
        x, y, z = to_key[0] - view[0], to_key[1] - view[1], to_key[2] - view[2]
        cosine = _dot((x, y, z), normal) / math.sqrt(x * x + y * y + z * z + 1e-12)
        shine = surfaces[surface, GLOSS] * key * math.pow(max(cosine, 0.0), surfaces[surface, SHININESS])
    glow = surfaces[surface, GLOW]
    return (
        _lit_channel(lights, 0, colour[0], key, fill, openness, shine, glow),
        _lit_channel(lights, 1, colour[1], key, fill, openness, shine, glow),
        _lit_channel(lights, 2, colour[2], key, fill, openness, shine, glow),
    )


@compiled
def _lit_channel(lights, channel, colour, key, fill, openness, shine, glow):
    light = (
        lights[AMBIENT, channel] * openness + key * lights[KEY_COLOUR, channel] + fill * lights[FILL_COLOUR, channel]
    )
    return colour * (glow + (1.0 - glow) * light) + shine * lights[KEY_COLOUR, channel]


@compiled
def direction_to(lights, light, point):
    """Return (unit vector from a point to a light, distance in metres)."""
    x, y, z = lights[light, 0] - point[0], lights[light, 1] - point[1], lights[light, 2] - point[2]
    distance = math.sqrt(x * x + y * y + z * z)
    return (x / distance, y / distance, z / distance), distance


@compiled
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
