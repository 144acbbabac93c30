"""
Read the package of a 3MF file: a ZIP archive of models in XML, and of pictures.

References
----------
.. [1] ECMA-376-2, "Open Packaging Conventions": names of parts, relationships.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree
from xml.parsers import expat

from rasterjit.io.load_warnings import MissingFileError
from rasterjit.io.resources import quote_name, take_members
from rasterjit.scene.memory_limits import MemoryBudget

_ROOT_RELATIONSHIPS = "_rels/.rels"
_MODEL_RELATIONSHIP = "/3dmodel"
"""End of the type of the relationship to the root model, in every edition."""

_DEFAULT_MODEL = "3d/3dmodel.model"

MEMORY_PER_XML_BYTE = 24
"""Memory of a byte of XML as a tree."""


class Package:
    """
    Reads the parts of a 3MF file, which is a package.

    Parameters
    ----------
    path : Path
    budget : MemoryBudget
        Counts all members before any is unpacked.

    Raises
    ------
    zipfile.BadZipFile, ValueError
        If it is no sound archive.
    """

    def __init__(self, path: Path, budget: MemoryBudget) -> None:
        budget.take("the file", path.stat().st_size)
        take_members(path, "3mf", MEMORY_PER_XML_BYTE, budget)
        self._archive = zipfile.ZipFile(path)
        self._members = {_normalize(one): one for one in self._archive.namelist()}

    def close(self) -> None:
        """Close the archive."""
        self._archive.close()

    def find_root(self) -> str:
        """Return the name of the root model, or raise `MissingFileError`."""
        if _ROOT_RELATIONSHIPS in self._members:
            for one in self.read_xml(_ROOT_RELATIONSHIPS):
                if one.get("Type", "").lower().endswith(_MODEL_RELATIONSHIP):
                    return _normalize(one.get("Target", ""))
        models = [name for name in self._members if name.endswith(".model")]
        defaults = [name for name in models if name.endswith(_DEFAULT_MODEL)]
        for name in (*defaults, *models):
            return name
        raise MissingFileError("a model")

    def content(self, name: str) -> bytes:
        """Return the content of a part, or raise `MissingFileError`."""
        if _normalize(name) not in self._members:
            raise MissingFileError(f"its part {quote_name(name)} is missing")
        return self._archive.read(self._members[_normalize(name)])

    def read_xml(self, name: str) -> ElementTree.Element:
        """Return the root element of a part that is XML, or raise ``ValueError``."""
        try:
            return _parse_xml(self.content(name))
        except expat.ExpatError as error:
            raise ValueError(f"its part {quote_name(name)}: {error}") from error


def _normalize(name: str) -> str:
    """Return a part's name for comparison, without regard to case."""
    return unquote(name.replace("\\", "/")).lstrip("/").lower()


def _parse_xml(content: bytes) -> ElementTree.Element:
    """
    Parse XML, keeping the prefixes of all names, and return the root element.

    `ElementTree.fromstring` puts the address of its name space before each name, so that one long
    address and many names take the memory of their product. Declarations of name spaces are left
    out.

    Raises
    ------
    ValueError
        About a document type, which could define entities.
    xml.parsers.expat.ExpatError
        If it is not well formed.
    """

    def refuse(*_: object) -> None:
        raise ValueError("it must have no document type definition")

    def start(tag: str, attributes: dict[str, str]) -> None:
        if "xmlns" in " ".join(attributes):
            attributes = {
                key: value for key, value in attributes.items() if key.partition(":")[0] != "xmlns"
            }
        builder.start(tag, attributes)

    builder, parser = ElementTree.TreeBuilder(), expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, builder.end
    parser.CharacterDataHandler = builder.data
    parser.Parse(content, True)
    return builder.close()


def strip_prefix(tag: object) -> str:
    """Return the name of an element or attribute without its prefix."""
    return tag.rpartition(":")[2] if isinstance(tag, str) else ""


def find_all(element: ElementTree.Element, *names: str) -> list[ElementTree.Element]:
    """Return the elements at a path of names below an element."""
    parents = [element]
    for name in names:
        parents = [one for parent in parents for one in parent if strip_prefix(one.tag) == name]
    return parents


def find_attribute(element: ElementTree.Element, name: str) -> str | None:
    """Return an attribute by its name without prefix."""
    return next((value for key, value in element.items() if strip_prefix(key) == name), None)
