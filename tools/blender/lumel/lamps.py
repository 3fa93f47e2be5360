"""Adds what the glTF exporter omits from lamps: sizes, area lights, and the cones of spots.

The exporter's mode *Unitless* (COMPAT) writes lamps in W/sr and W/m², the same units as for
emissive materials. Everything here uses these units.
"""

import base64
import math

import bpy
from mathutils import Vector

from .glb import lumel_extras

# Name prefix of nodes that represent area lights; they are not part of the level.
AREA_PREFIX = "lumel area light "
# Corners of the polygon that approximates a disc. Its area is 0.2 % too small, which the radiance
# compensates.
DISC_CORNERS = 64
# Alpha of the polygon: the share of other light that it absorbs. A fully transparent polygon would
# not emit.
CLEAR_ALPHA = 0.01


def complete(glb, objects):
    """Adds to an exported level what its lamps lack. Returns warnings."""
    warnings = []
    extension = glb.json.get("extensions", {}).get("KHR_lights_punctual", {})
    for light in extension.get("lights", []):
        lamp = bpy.data.lights.get(light.get("name", ""))
        if lamp is not None:
            size(light, lamp)
    for o in objects:
        if o.type == "LIGHT" and o.data.type == "AREA":
            warnings += add_area(glb, o)
    return warnings


def size(light, lamp):
    if lamp.type == "SUN":
        lumel_extras(light, angle=min(math.degrees(lamp.angle), 180.0))
        return
    lumel_extras(light, radius=lamp.shadow_soft_size)
    if lamp.type == "SPOT":
        lumel_extras(light, ies=data_uri(cone_profile(lamp)))
        # The profile shapes the beam; the extension's own falloff would dim it twice.
        outer = light["spot"]["outerConeAngle"]
        light["spot"]["innerConeAngle"] = outer * (1 - 1e-3)


def spot_falloff(cosine, lamp):
    """Cycles' relative intensity of a spot at an angle from its axis."""
    edge = math.cos(0.5 * lamp.spot_size)
    width = (1 - edge) * lamp.spot_blend
    if width <= 0:
        return 1.0 if cosine >= edge else 0.0
    x = min(max((cosine - edge) / width, 0.0), 1.0)
    return x * x * (3 - 2 * x)


def cone_profile(lamp):
    """The beam as an IES LM-63 profile, because glTF's own falloff has a different shape."""
    half = math.degrees(0.5 * lamp.spot_size)
    angles = [half * i / 90 for i in range(91)]
    values = [spot_falloff(math.cos(math.radians(a)), lamp) for a in angles]
    # Rounding may leave the edge dark; the extension's cone ends there anyway.
    values[-1] = values[-1] if lamp.spot_blend > 0 else 1.0
    lines = ["IESNA:LM-63-2002", "TILT=NONE", f"1 -1 1 {len(angles)} 1 1 2 0 0 0", "1 1 0"]
    lines.append(" ".join(f"{a:.5f}" for a in angles))
    lines.append("0")
    lines.append(" ".join(f"{v:.6f}" for v in values))
    return "\n".join(lines) + "\n"


def data_uri(text):
    encoded = base64.b64encode(text.encode()).decode()
    return "data:application/octet-stream;base64," + encoded


def color(lamp):
    c = Vector(lamp.color)
    if getattr(lamp, "use_temperature", False):
        t = lamp.temperature_color
        c = Vector((c[0] * t[0], c[1] * t[1], c[2] * t[2]))
    return c


def area_shape(lamp):
    """Corners in the lamp's own plane, clockwise as seen from +Z, because the lamp shines along
    -Z."""
    x = 0.5 * lamp.size
    y = 0.5 * (lamp.size_y if lamp.shape in ("RECTANGLE", "ELLIPSE") else lamp.size)
    if lamp.shape in ("SQUARE", "RECTANGLE"):
        return [(-x, -y, 0), (-x, y, 0), (x, y, 0), (x, -y, 0)]
    turns = [-2 * math.pi * i / DISC_CORNERS for i in range(DISC_CORNERS)]
    return [(x * math.cos(t), y * math.sin(t), 0) for t in turns]


def polygon_area(points):
    """Area of a planar polygon."""
    total = Vector()
    for a, b in zip(points[1:], points[2:]):
        total += (a - points[0]).cross(b - points[0])
    return 0.5 * total.length


def add_area(glb, o):
    """Adds an area light as an emissive, transparent polygon without a lightmap."""
    lamp, warnings = o.data, []
    points = [o.matrix_world @ Vector(p) for p in area_shape(lamp)]
    if o.matrix_world.determinant() < 0:
        points.reverse()
    area = polygon_area(points)
    if area <= 0 or lamp.energy <= 0:
        return [f"area light {o.name}: no area or no power; it gives no light"]
    if getattr(lamp, "spread", math.pi) < math.pi * 0.999:
        warnings.append(f"area light {o.name}: its spread is taken as 180 degrees")
    # A Lambertian surface that emits the power. Without *Normalize*, the power is per area.
    power = lamp.energy * 2 ** getattr(lamp, "exposure", 0.0)
    radiance = power / math.pi / (area if getattr(lamp, "normalize", True) else 1.0)
    emitted = color(lamp) * radiance
    strength = max(emitted)
    if strength <= 0:
        return warnings + [f"area light {o.name}: it is black; it gives no light"]
    glb.use_extension("KHR_materials_emissive_strength")
    material = glb.add(
        "materials",
        {
            "name": AREA_PREFIX + o.name,
            # The polygon lets other light pass, because Cycles' lamps do not block light.
            "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, CLEAR_ALPHA]},
            "alphaMode": "BLEND",
            "emissiveFactor": [c / strength for c in emitted],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": strength / CLEAR_ALPHA}},
        },
    )
    # Blender's up axis is Z, glTF's is Y.
    node = glb.add_fan(AREA_PREFIX + o.name, [(p.x, p.z, -p.y) for p in points], material)
    lumel_extras(node, density=0)
    return warnings
