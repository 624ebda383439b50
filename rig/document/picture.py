"""Pictures of other programs in a document: a logo as PNG or SVG, checked before it is embedded.

What is accepted loads nothing, runs nothing and is small: a document stays one file that is safe to open.
"""

from __future__ import annotations

import base64
import math
import re
import struct
import zlib
from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree

MOST_BYTES = 1_000_000
MOST_PIXELS = 4_000_000
PNG = b"\x89PNG\r\n\x1a\n"
HEADER_BYTES, CHANNELS = 13, {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Length of a PNG's first chunk, and samples a pixel by its kind of colour (PNG specification, 11.2.2)."""
FORBIDDEN = frozenset({
    "script", "foreignobject", "image", "feimage", "iframe", "object", "embed", "audio", "video", "a", "animate", "set",
    "animatemotion", "animatetransform", "handler", "listener",
})  # fmt: skip
"""Elements of SVG that run, load or move something."""
LARGEST_SVG = 20_000
"""Elements and attributes of an SVG: a logo has a few hundred."""
OWN_REFERENCE = re.compile(r"url\(\s*['\"]?#|url\(\s*['\"]?data:font", re.IGNORECASE)
LENGTH = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(?:px|pt|mm|cm|in|pc|em)?\s*$")


@dataclass(frozen=True)
class Picture:
    """A checked picture: its bytes, its kind, and width over height."""

    content: bytes
    kind: Literal["png", "svg+xml"]
    ratio: float
    alternative: str = "Logo"

    @property
    def data_uri(self) -> str:
        """The picture as the source of an image that needs no further file."""
        return f"data:image/{self.kind};base64,{base64.b64encode(self.content).decode()}"


def picture_of(content: bytes) -> Picture:
    """A picture from a file's content.

    Raises:
        ValueError: the content is neither a PNG nor a self-contained SVG, or it is too large.
    """
    if len(content) > MOST_BYTES:
        raise ValueError(f"the image is {len(content)} bytes in size; allowed: at most {MOST_BYTES}. Fix: reduce "
            "the size of the image")
    if content.startswith(PNG):
        return Picture(content, "png", _checked_png(content))
    if b"<svg" in content[:4096].lower() or b"<?xml" in content[:64]:
        return Picture(content, "svg+xml", _checked_svg(content))
    raise ValueError("the file is neither a PNG nor an SVG image. Fix: save the logo as PNG or SVG")


def _checked_png(content: bytes) -> float:
    """Width over height of a PNG whose chunks are whole.

    Raises:
        ValueError: it is damaged or too large.
    """
    place, width, height, row_bits = len(PNG), 0, 0, 0
    data: list[bytes] = []
    while place + 12 <= len(content):
        (size,), kind = struct.unpack(">I", content[place : place + 4]), content[place + 4 : place + 8]
        body, check = content[place + 8 : place + 8 + size], content[place + 8 + size : place + 12 + size]
        if len(check) < 4 or struct.unpack(">I", check)[0] != zlib.crc32(kind + body):
            raise ValueError("the PNG file is damaged or incomplete: a checksum is wrong. Fix: save the logo again")
        if kind == b"IHDR" and size == HEADER_BYTES:
            width, height, depth, colour = struct.unpack(">IIBB", body[:10])
            if not 0 < width * height <= MOST_PIXELS:
                raise ValueError(f"the PNG has {width} x {height} pixels; allowed: at most {MOST_PIXELS} in total")
            row_bits = width * depth * CHANNELS.get(colour, 4)
        elif kind == b"IDAT":
            data.append(body)
        elif kind == b"IEND":
            break
        place += 12 + size
    if not width or not data:
        raise ValueError("the PNG file is incomplete. Fix: save the logo again")
    _check_pixels(b"".join(data), row_bits // 8 * height, (row_bits // 8 + 2) * height + 64 * (height + 8))
    return width / height


def _check_pixels(data: bytes, least: int, most: int) -> None:
    """Nothing where a PNG's pixels can be unpacked and take as many bytes as its header lets expect.

    Raises:
        ValueError: they are not.
    """
    unpacking = zlib.decompressobj()
    try:
        pixels = unpacking.decompress(data, most)
    except zlib.error as error:
        raise ValueError(f"the PNG file is damaged: {error}. Fix: save the logo again") from error
    if not unpacking.eof or len(pixels) < least:
        raise ValueError("the PNG file does not contain as many pixels as its header states. Fix: save the logo again")


def _checked_svg(content: bytes) -> float:
    """Width over height of an SVG that loads and runs nothing.

    Raises:
        ValueError: it is no well-formed SVG, or has parts that are not accepted.
    """
    if re.search(rb"<!(doctype|entity)", content, re.IGNORECASE):
        content = re.sub(rb"<!DOCTYPE\s+svg\s+PUBLIC\s+\"[^\"<>\[]*\"\s+\"[^\"<>\[]*\"\s*>", b"", content, count=1)
        if re.search(rb"<!(doctype|entity)", content, re.IGNORECASE):
            raise ValueError("the SVG declares entities. Fix: save it as plain SVG")
    try:
        root = ElementTree.fromstring(content)  # entities, the danger of this parser, are refused above
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ValueError(f"the SVG is not well-formed XML: {error}. Fix: save the logo again") from error
    if _local(root.tag) != "svg":
        raise ValueError(f"the file is XML, but its root element is {_local(root.tag)[:40]}, not svg")
    count = 0
    for element in root.iter():
        count += 1 + len(element.attrib)
        _check_element(element)
    if count > LARGEST_SVG:
        raise ValueError(f"the SVG has {count} elements and attributes; allowed: at most {LARGEST_SVG}")
    return _ratio(root)


def _check_element(element: ElementTree.Element) -> None:
    """Nothing where an element of an SVG loads and runs nothing.

    Raises:
        ValueError: it does.
    """
    name = _local(element.tag)
    if name in FORBIDDEN:
        raise ValueError(f"the SVG contains <{name}>. Fix: save it as plain SVG with paths only")
    for key, value in element.attrib.items():
        own = _local(key)
        if own.startswith("on"):
            raise ValueError(f"the SVG contains the script attribute {own}. Fix: save it as plain SVG")
        if own == "href" and not value.startswith("#"):
            raise ValueError(f"the SVG refers to {value[:60]!r}. Fix: embed this content, or convert it to paths")
        _check_style(value)
    if name == "style":
        _check_style(element.text or "")


def _check_style(text: str) -> None:
    loose = "".join(re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL).split())
    outside = re.sub(OWN_REFERENCE, "", loose)
    if "url(" in outside.lower() or "@import" in loose.lower() or "\\" in loose:
        raise ValueError("a style in the SVG refers to another file. Fix: save it as plain SVG")


def _local(tag: object) -> str:
    """Name of an element or attribute without its name space."""
    return tag.rpartition("}")[2].lower() if isinstance(tag, str) else ""


def _ratio(root: ElementTree.Element) -> float:
    """Width over height of a drawing, by its view box or its sides.

    Raises:
        ValueError: it states neither.
    """
    box = re.split(r"[\s,]+", root.get("viewBox", "").strip())
    sides: list[float] = []
    try:
        sides = [float(text) for text in box[2:4]]
    except ValueError:
        sides = []
    if len(sides) != 2:
        matches = [LENGTH.match(root.get(name, "")) for name in ("width", "height")]
        sides = [float(match[1]) for match in matches if match]
    if len(sides) != 2 or not all(math.isfinite(side) and side > 0.0 for side in sides):
        raise ValueError("the SVG does not state its size. Fix: save it with a viewBox or with width and height")
    if not 0.02 <= sides[0] / sides[1] <= 50.0:
        raise ValueError(f"the SVG is {sides[0]:g} x {sides[1]:g}; the longer side may be at most 50 times the "
            "shorter side")
    return sides[0] / sides[1]
