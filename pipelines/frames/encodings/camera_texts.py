"""Cameras in text files: numbers, `fx = 600` pairs, tables; of COLMAP, OpenCV and ARKitScenes.

All become the keys and values of a camera file in JSON.
"""

import re
from configparser import ConfigParser
from configparser import Error as ConfigError
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from pipelines.errors import FormatError
from pipelines.storage.files import read_bytes, read_text

MAX_BYTES = 2**20  # of a file; cameras have some thousand
MATRIX_SIZES = (9, 12, 16)  # numbers of 3x3, 3x4 and 4x4
MAX_LEVELS = 4  # of XML; OpenCV's matrices have two
FORMS = "fx fy cx cy, a 3x3 matrix, or lines such as `fx = 600` are expected"
COMMENT = re.compile(r"(#|//|%).*")
KEY = re.compile(r"([A-Za-z_][\w.]*)\s*[:=]")
QUOTES = re.compile("[\"']")
NAME = re.compile(r"[A-Za-z_][\w.]*")
BRACKETS = re.compile(r"[\[\](){};,\s]+")
COLMAP_LINE = re.compile(r"\s*\d+\s+([A-Z_]+)\s+(.+)")
COLMAP_CENTER = 0.5  # pixels: COLMAP's images begin at a pixel's corner, ours at its center
FOCAL, FOCALS, CENTER, FOUR_K = ("f",), ("fx", "fy"), ("cx", "cy"), ("k1", "k2", "k3", "k4")
COLMAP_MODELS = {
    "SIMPLE_PINHOLE": (*FOCAL, *CENTER),
    "PINHOLE": (*FOCALS, *CENTER),
    "SIMPLE_RADIAL": (*FOCAL, *CENTER, "k1"),
    "RADIAL": (*FOCAL, *CENTER, "k1", "k2"),
    "OPENCV": (*FOCALS, *CENTER, "k1", "k2", "p1", "p2"),
    "FULL_OPENCV": (*FOCALS, *CENTER, "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "OPENCV_FISHEYE": (*FOCALS, *CENTER, *FOUR_K),
}


def read_camera_text(path: Path) -> dict[str, Any]:
    """Return the keys and values of the camera in a text file.

    Raises:
        FormatError: the file has none of the known forms, or several cameras.
    """
    text = read_text(path, MAX_BYTES)
    text = QUOTES.sub("", "\n".join(COMMENT.sub("", line) for line in text.splitlines())).strip()
    if COLMAP_LINE.match(text):
        return _colmap_camera(path, text.splitlines())
    if "fx" in (table := _table(text)):
        return table
    _heading, *parts = KEY.split(text)
    if parts:
        return _pairs(path, parts[::2], parts[1::2])
    words = [word for word in BRACKETS.split(text) if word]
    half = len(words) // 2
    # `fx 600` in each line, or the line fx,fy,cx,cy above its values.
    for names, values in ((words[::2], words[1::2]), (words[:half], words[half:])):
        if words and len(names) == len(values) and all(map(NAME.fullmatch, names)):
            return _pairs(path, names, values)
    numbers = _value(text)
    match numbers:
        case [fx, fy, cx, cy]:
            return {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
        case list() if len(numbers) in MATRIX_SIZES:
            return {"K": numbers}
        case list() | float():
            count = len(numbers) if isinstance(numbers, list) else 1
            raise FormatError(path, f"{count} numbers", FORMS)
    raise FormatError(path, "holds a text that is no number", FORMS)


def read_camera_ini(path: Path) -> dict[str, Any]:
    """Return the sections of an INI file, each with its keys in small letters and their values.

    Raises:
        FormatError: lines without a section, or other text.
    """
    parser = ConfigParser(interpolation=None, strict=False)
    try:
        parser.read_string(read_text(path, MAX_BYTES))
    except ConfigError as error:
        found = f"cannot be read as INI ({' '.join(str(error).split())})"
        raise FormatError(
            path, found, "a [section] with lines such as `fx = 600` is expected"
        ) from error
    return {
        name: {key: _value(text) for key, text in parser[name].items()}
        for name in parser.sections()
    }


def read_pincam(path: Path) -> dict[str, Any]:
    """Return the keys and values of the camera in a `.pincam` of ARKitScenes, one line of numbers.

    Raises:
        FormatError: the line has other content.
    """
    line = read_text(path, MAX_BYTES)
    match _value(line):
        case [width, height, fx, fy, cx, cy]:
            sizes = {"width": width, "height": height}
            return {**sizes, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    raise FormatError(path, f"holds {line!r:.60}", "`width height fx fy cx cy` is expected")


def _table(text: str) -> dict[str, Any]:
    """Return the values of lines `name,value`, as of the RealSense Viewer's `Fx,600`."""
    rows = (line.split(",") for line in text.splitlines())
    return {row[0].strip().lower(): _value(row[1]) for row in rows if len(row) == 2}


def read_camera_xml(path: Path) -> dict[str, Any]:
    """Return the keys and values of an XML file of OpenCV's FileStorage.

    Raises:
        FormatError: the file is damaged, or is other XML.
    """
    expected = "XML of OpenCV, with the root `opencv_storage`, is expected"
    try:
        root = fromstring(read_bytes(path, MAX_BYTES))
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise FormatError(path, f"cannot be read as XML ({error})", expected) from error
    if root.tag != "opencv_storage":
        raise FormatError(path, f"is XML with the root `{root.tag}`", expected)
    return {node.tag: _content(node, MAX_LEVELS) for node in root}


def _pairs(path: Path, keys: list[str], texts: list[str]) -> dict[str, Any]:
    """Return the values by their keys; of two cameras in one file, none is preferred."""
    values: dict[str, Any] = {}
    for key, text in zip(keys, texts, strict=True):
        value = _value(text)
        if values.setdefault(key, value) != value:
            expected = "give fx,fy,cx,cy of the depth image as --intrinsics"
            raise FormatError(path, f"states two values of {key}", expected)
    return values


def _colmap_camera(path: Path, lines: list[str]) -> dict[str, Any]:
    """Return the only camera of `ID MODEL WIDTH HEIGHT PARAMETERS...` lines.

    Cameras that differ by their number alone are one camera.
    """
    cameras = {BRACKETS.sub(" ", line).strip().partition(" ")[2] for line in lines if line.strip()}
    if len(cameras) > 1:
        expected = "give fx,fy,cx,cy of the depth image as --intrinsics"
        raise FormatError(path, f"holds {len(cameras)} different cameras of COLMAP", expected)
    model, *rest = cameras.pop().split()
    if model not in COLMAP_MODELS:
        known = ", ".join(COLMAP_MODELS)
        raise FormatError(path, f"has a camera of the model {model}", f"{known} are read")
    names, numbers = ("width", "height", *COLMAP_MODELS[model]), _value(" ".join(rest))
    if not isinstance(numbers, list) or len(numbers) != len(names):
        raise FormatError(
            path, f"has the camera {model} {' '.join(rest)}", f"{' '.join(names)} are expected"
        )
    values = dict(zip(names, numbers, strict=True))
    focal = values.pop("f", None)
    values = {"fx": focal, "fy": focal} | values if focal is not None else values
    shifted = {name: values[name] - COLMAP_CENTER for name in CENTER}
    return {**values, **shifted, "camera_model": model}


def _value(text: str) -> float | list[float] | str:
    """Return the number, or the numbers, in a text, or the text if it holds others."""
    parts = [part for part in BRACKETS.split(text) if part]
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        return text.strip(" \t\n,;")
    return numbers[0] if len(numbers) == 1 else numbers


def _content(node: Element, levels: int) -> Any:  # noqa: ANN401 - a value, or a mapping
    children = list(node) if levels else []
    if not children:
        return _value(node.text or "")
    return {child.tag: _content(child, levels - 1) for child in children}
