"""Read an OBJ file as triangle geometries, one for each part and material."""

import codecs
import re
from pathlib import Path

import numpy as np

from dfd.common.linear_algebra import Float32, Float64, Int32, Int64
from dfd.mesh.appearance import WHITE, Material, Wrap
from dfd.mesh.colors import ranged
from dfd.mesh.file.assets import AssetFolder
from dfd.mesh.file.obj.text import ObjText, parse
from dfd.mesh.file.polygons import distinct_rows, long_faces, ranges, triangulate
from dfd.mesh.file.primitives import Geometry, MeshInstance
from dfd.mesh.file.scene_file import FileSource, SceneFile
from dfd.mesh.file.shading import FLAT, UNSAID
from dfd.mesh.file.text import decoded, encoding_of, shortened
from dfd.mesh.weld import first_occurrences

_PICTURES = (b"map_", b"bump", b"disp", b"decal", b"refl", b"norm")  # prefixes of MTL keywords that name an image
_NUMBER = rb"\s+[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?=\s)"
_OPTION = re.compile(  # an option of a texture, and its values
    rb"-(?:([ost])((?:%(n)s){1,3})|(mm)((?:%(n)s){1,2})|(imfchan|type)(\s+\w+)|(\w+)((?:\s+(?:on|off)(?=\s)|%(n)s)+))\s+"
    % {b"n": _NUMBER},
    re.IGNORECASE,
)
# Options that only filter a texture, or set what it affects in materials that are not read.
_HARMLESS = ("blendu", "blendv", "bm", "boost", "texres", "type")

_GROUP_KEYWORDS = ("g", "o", "usemtl")  # in order of precedence for equal names


def read(path: Path, data: bytes, assets: AssetFolder, at_rest: bool) -> SceneFile:
    """Return the scene of an OBJ file; raise ValueError if the file is malformed."""
    text = parse(data)
    instances, numbers, corner_rows = _instances(text, path, assets)
    source = FileSource(np.frombuffer(data, np.uint8), numbers, assets.root, corner_rows)
    return SceneFile.of(path, instances, own_vertices=text.positions, source=source)


def _instances(text: ObjText, path: Path, assets: AssetFolder) -> tuple[list[MeshInstance], Int64, Int32]:
    """Return the mesh instances, the index (R,) of each row's vertex in the file, and the row (C,) of each face corner.

    A row is a vertex of an instance. Parts are the objects (`o`) of the file, or its groups (`g`) if it has at most one
    object. Within a part, faces are sorted by material. Faces with fewer than three corners are skipped with a warning.
    Their corners have the row −1.
    """
    used = used_materials(text, assets)[0]
    materials = {name: _material(name.decode(text.encoding), lines, assets) for name, lines in used.items()}
    part_names, part = _parts(text, path.stem)
    material_names, material = _state_at_faces(text, "usemtl", b"")
    known = np.array([name in materials for name in material_names], bool)
    material = np.where(known[material], material, -1)  # all undefined materials count as one material
    faces = np.flatnonzero(long_faces(path, text.sizes, text.face_lines))
    order = faces
    if len(faces) and ((material != material[0]).any() or (part != part[0]).any()):
        order = faces[np.lexsort((first_occurrences(material)[1][faces], first_occurrences(part)[1][faces]))]
    begins = np.flatnonzero(np.diff(part[order] * (len(material_names) + 1) + material[order], prepend=-2))
    counts = np.diff(begins, append=len(order))  # number of faces with the same part and material
    sizes = text.sizes[order]
    primitive = np.repeat(np.repeat(np.arange(len(begins)), counts), sizes)
    corners = ranges((np.cumsum(text.sizes) - text.sizes)[order], sizes)
    rows, row = distinct_rows(np.column_stack([primitive, text.corners[corners]]))
    corner_rows = np.full(len(text.corners), -1, np.int32)
    corner_rows[corners] = row
    triangles = row[triangulate(text.positions, text.corners[corners, 0], sizes)]
    starts = np.searchsorted(rows[:, 0], np.arange(len(begins)))
    stops = np.cumsum(sizes - 2)[begins[1:] - 1]
    own_rows, own_faces = np.split(rows[:, 1:], starts[1:]), np.split(triangles, stops)
    smoothing = np.split(np.repeat(_smoothing(text)[order], sizes - 2), stops)
    colors = None if text.colors is None else ranged(text.colors)
    instances = []
    for face, start, own, drawn, smooth in zip(
        order[begins].tolist(), starts.tolist(), own_rows, own_faces, smoothing, strict=False
    ):
        own_material = materials.get(material_names[material[face]]) if material[face] >= 0 else None
        own_colors = None if colors is None else colors[own[:, 0]]
        geometry = _geometry(text, own, drawn - start, own_colors, own_material, smooth)
        instances.append(MeshInstance(part_names[part[face]], part_names[part[face]], geometry))
    return instances, rows[:, 1], corner_rows


def _geometry(
    text: ObjText, rows: Int64, faces: Int64, colors: Float32 | None, material: Material | None, smoothing: Int64
) -> Geometry:
    """Return a geometry. `rows` (N, 3) are indices of position, UV and normal; `faces` (F, 3) index the rows."""
    return Geometry(
        text.positions[rows[:, 0]],
        faces,
        _taken(text.normals, rows[:, 2]),
        _taken(text.uv, rows[:, 1]),
        colors,
        material=material,
        smoothing=smoothing,
    )


def _taken(values: Float64, index: Int64) -> Float64 | None:
    """Return rows (N, K) of `values`, NaN where the index (N,) is −1; None if all are −1."""
    known = index >= 0
    if not known.any():
        return None
    return np.where(known[:, None], values[np.where(known, index, 0)], np.nan)


def _smoothing(text: ObjText) -> Int64:
    """Return the smoothing group (P,) of each face, as in `shading`."""
    names, state = _state_at_faces(text, "s", b"")
    flat = [name.lower() in (b"off", b"0", b"null") for name in names]
    return np.array([UNSAID, *(FLAT if flat[index] else index for index in range(1, len(names)))])[state]


def _parts(text: ObjText, default: str) -> tuple[list[str], Int64]:
    """Return the names of the parts, and the index (P,) of each face's part."""
    none, *found = [_state_at_faces(text, keyword, b"") for keyword in ("", "o", "g")]
    several = [(names, part) for names, part in found if (part != part[:1]).any()]
    named = [(names, part) for names, part in found if part.any()]  # here, all faces have one name
    names, part = [*several, *named, none][0]
    return [name.decode(text.encoding) or default for name in names], part


def _state_at_faces(text: ObjText, keyword: str, default: bytes) -> tuple[list[bytes], Int64]:
    """Return the names after a keyword, `default` first, and the index (P,) of the name that applies to each face."""
    numbers, lines, values = {default: 0}, [-1], [0]
    for line, found, name in text.statements:
        if found == keyword:
            lines.append(line)
            values.append(numbers.setdefault(name or default, len(numbers)))
    return list(numbers), np.array(values)[np.searchsorted(lines, text.face_lines) - 1]


def face_groups(data: bytes) -> dict[str, Int64]:
    """Return the vertices (N,), ascending, of each face group in the text of an OBJ file, by the group's name.

    Every word after `g` names a group, and so do all words of this line together. An `o` or `usemtl` line has one name.
    A name applies to all faces up to the next line with the same keyword. Faces before the first line with a keyword
    are in no group of this keyword. Groups without faces are left out.
    """
    text = parse(data)
    kept = np.repeat(text.sizes >= 3, text.sizes)  # `read` skips faces of one or two corners
    vertices = text.corners[kept, 0]
    found: dict[str, Int64] = {}
    for keyword in _GROUP_KEYWORDS:
        names, state = _state_at_faces(text, keyword, b"")
        state = np.repeat(state, text.sizes)[kept]
        ends = np.cumsum(np.bincount(state, minlength=len(names)))
        of_word: dict[str, list[Int64]] = {}
        shown = [name.decode(text.encoding) for name in names]
        for name, own in zip(shown, np.split(vertices[np.argsort(state, kind="stable")], ends[:-1]), strict=True):
            for word in dict.fromkeys([name, *(name.split() if keyword == "g" else [])]):
                of_word.setdefault(word, []).append(own)
        for word, members in of_word.items():
            if word and any(map(len, members)):
                found.setdefault(word, np.unique(np.concatenate(members)))
    return found


def picture_name(line: bytes) -> bytes:
    """Return the image file that a line of an MTL file names, without options; b"" if the line names none."""
    return _picture(line)[0]


def _picture(line: bytes) -> tuple[bytes, dict[str, list[str]]]:
    """Return the image file that a line of an MTL file names, and the values of each option before the name."""
    keyword, _, rest = line.strip().replace(b"\t", b" ").partition(b" ")
    if not keyword.lower().startswith(_PICTURES):
        return b"", {}
    options: dict[str, list[str]] = {}
    rest = rest.lstrip()
    while found := _OPTION.match(rest):
        name, values = (each for each in found.groups() if each is not None)
        options[decoded(name).lower()] = decoded(values).split()
        rest = rest[found.end() :]
    return rest.strip(), options


def _textured(line: bytes, name: str, assets: AssetFolder) -> Material | None:
    """Return a material with the texture that a line of an MTL file names, or None if it cannot be read.

    The options -s, -o, -clamp and -mm are applied; other options that change the texture are noted for a warning.
    """
    file, options = _picture(line)
    picture = decoded(file)
    texels = assets.texture(picture, picture)
    if texels is None:
        return None

    def numbers(option: str, *defaults: float) -> list[float]:
        given = [float(each) for each in options.get(option, ())]
        return [*given, *defaults[len(given) :]]

    base, gain = numbers("mm", 0, 1)
    if (base, gain) != (0, 1):
        colors = texels[..., :3] * gain + base * 255
        texels = np.concatenate([np.rint(colors).clip(0, 255).astype(np.uint8), texels[..., 3:]], axis=-1)
    scale, offset = numbers("s", 1, 1, 1), numbers("o", 0, 0, 0)
    wrap: Wrap = "clamp" if options.get("clamp") == ["on"] else "repeat"
    for option, values in options.items():
        changes = any(numbers("t", 0)) if option == "t" else values != ["off"] and option not in _HARMLESS
        if changes and option not in ("s", "o", "clamp", "mm"):
            assets.notes.add(f"the option -{option} of the texture {shortened(picture)} is ignored")
    return Material(WHITE, texels, (wrap, wrap), name=name, placement=(scale[0], scale[1], offset[0], offset[1]))


def used_materials(text: ObjText, assets: AssetFolder) -> tuple[dict[bytes, list[bytes]], set[bytes]]:
    """Return the MTL lines of each material that the file uses, by its name, and the MTL files that could be read.

    Names are the bytes of the OBJ file. If an MTL file has another encoding, the decoded names decide.
    """
    used = dict.fromkeys(name for _, keyword, name in text.statements if keyword == "usemtl")
    found: dict[bytes, list[bytes]] = {}
    read, names = set(), list[bytes]()
    for line in [rest for _, keyword, rest in text.statements if keyword == "mtllib" and rest]:
        # A line names one MTL file, whose name may contain spaces, or several files separated by spaces.
        names += [line] if b" " not in line or _library(line, assets) is not None else line.split()
    for library in dict.fromkeys(names):
        content = _library(library, assets)
        if content is None:
            assets.unreadable.add(decoded(library))
            continue
        read.add(library)
        own = _material_lines(content)
        encoding = encoding_of(content)
        by_text = {name.decode(encoding): lines for name, lines in own.items()}
        for name in used:
            lines = own.get(name, by_text.get(name.decode(text.encoding)))
            if lines is not None:
                found.setdefault(name, lines)
    return found, read


def _library(name: bytes, assets: AssetFolder) -> bytes | None:
    try:
        return assets.read(decoded(name)).removeprefix(codecs.BOM_UTF8)
    except (ValueError, OSError):
        return None


def _material(name: str, lines: list[bytes], assets: AssetFolder) -> Material:
    """Return a material with its texture or, if it has no texture, with its diffuse color.

    The diffuse color of a textured material is ignored, because programs disagree whether it multiplies the texture.
    """
    colors: dict[bytes, Float64] = {}
    pictures: dict[bytes, bytes] = {}
    for line in lines:
        keyword, *words = line.lower().split()
        if keyword in (b"kd", b"ke") and len(words) >= 3:
            try:
                colors[keyword] = np.clip([float(word) for word in words[:3]], 0, 1)
            except ValueError:
                continue
        elif keyword in (b"map_kd", b"map_ke") and picture_name(line):
            pictures[keyword[4:]] = line
    color, picture = colors.get(b"kd"), pictures.get(b"kd")
    if picture is None and color is not None and not color.any():  # a black surface shows only the light that it emits
        color, picture = colors.get(b"ke", color), pictures.get(b"ke")
    if picture is not None and (material := _textured(picture, name, assets)) is not None:
        return material
    if picture is not None or color is None or not np.isfinite(color).all():
        return Material(name=name, is_default=True)
    red, green, blue = color.tolist()
    return Material((red, green, blue, 1.0), name=name)


def _material_lines(content: bytes) -> dict[bytes, list[bytes]]:
    """Return the lines of each material of an MTL file, by its name, without the `newmtl` line."""
    found: dict[bytes, list[bytes]] = {}
    lines: list[bytes] = []
    for line in content.splitlines():
        words = line.split()
        if words and words[0].lower() == b"newmtl":
            lines = found.setdefault(b" ".join(words[1:]), [])
        elif words and not words[0].startswith(b"#"):
            lines.append(line.strip())
    return found
