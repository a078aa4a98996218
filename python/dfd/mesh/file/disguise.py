"""Recognize files that are not what their ending says."""

_LFS = b"version https://git-lfs"
_DISGUISES = {  # by the first bytes of a file
    _LFS: "a Git LFS pointer, which `git lfs pull` replaces by the file",
    **dict.fromkeys((b"\xff\xfe", b"\xfe\xff"), "text in the encoding UTF-16; convert it to UTF-8"),
    **dict.fromkeys((b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd"), "compressed data; decompress it first"),
    **dict.fromkeys((b"PK\x03\x04", b"Rar!", b"7z\xbc\xaf"), "an archive, such as a ZIP file; unpack it first"),
    **dict.fromkeys((b"<!doctype", b"<html", b"<head"), "an HTML page, as after a failed download"),
    **dict.fromkeys((b"<?xml", b"<"), "XML text"),
    **dict.fromkeys((b"\x89png", b"\xff\xd8\xff", b"gif8"), "a picture"),
    b"%pdf": "a PDF document",
    b"kaydara fbx": "an FBX file",
    b"blender": "a Blender file",
}
_MESHES = {b"gltf": ".glb", b"ply": ".ply", b"solid": ".stl", b"off": ".off", b"{": ".gltf"}  # by the first letters


def disguise(data: bytes, ending: str) -> str | None:
    """Return what a file that is no mesh of the format `ending` seems to be; None if its first bytes do not tell."""
    begin = data[:64]
    if len(begin) > 8 and any(begin[1::2]) != any(begin[::2]):
        begin = b"\xff\xfe"  # every other byte of UTF-16 text is 0
    start = begin.removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    for mark, what in _DISGUISES.items():
        if begin.startswith(mark) or start.startswith(mark.lower()):
            return what
    other = next((each for mark, each in _MESHES.items() if start.startswith(mark)), ending)
    return None if {ending, other} in ({ending}, {".glb", ".gltf"}) else f"content of the format {other[1:].upper()}"


def is_pointer(data: bytes) -> bool:
    """Return whether a file is a Git LFS pointer."""
    return data.startswith(_LFS)
