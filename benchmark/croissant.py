"""Metadata of a published folder in Croissant 1.1 (MLCommons), with the fields for responsible AI.

HDF5 has no records in Croissant: shards are files with digests, the records are those of the Parquet indices.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from typing import Any

from eigenbench._version import __version__

_CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
_CITE = (
    "@inproceedings{weng2023eigenlengths, title={Towards Learning Geometric Eigen-Lengths Crucial for Fitting Tasks}, "
    "booktitle={ICML}, year={2023}}"
)
_TYPES = {"u": "sc:Integer", "i": "sc:Integer", "b": "sc:Boolean"}


@dataclass(frozen=True, slots=True)
class PublishedFile:
    """A file of the folder: its path there, bytes, sha256 and media type."""

    path: str
    size: int
    sha256: str
    kind: str


def croissant(
    version: str, files: Sequence[PublishedFile], columns: Mapping[str, Mapping[str, str]], address: str
) -> dict[str, Any]:
    """Return the metadata; `columns` has the numpy kind of each column of each Parquet index, by its path."""
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": ["http://mlcommons.org/croissant/1.1", "http://mlcommons.org/croissant/RAI/1.0"],
        "name": "eigenbench",
        "description": "Pairs of point clouds: does the object fit the environment, and which lengths decide it?",
        "url": address,
        "license": "https://creativecommons.org/publicdomain/zero/1.0/",
        "version": f"{version}.0",
        "datePublished": date.today().isoformat(),
        "creator": {"@type": "sc:Organization", "name": f"eigenbench {__version__}"},
        "citeAs": _CITE,
        "isLiveDataset": False,
        "rai:dataCollection": "Drawn by the software's random streams from parametric shapes; nothing was recorded.",
        "rai:dataLimitations": "Rigid parametric shapes, translations only; public test labels can be made again.",
        "rai:dataBiases": "Few shapes carry the test splits; categories are equally likely.",
        "rai:dataUseCases": "Training and testing models of fitting; not for decisions about safety.",
        "rai:personalSensitiveInformation": "None.",
        "rai:dataReleaseMaintenancePlan": "A version never changes; a new one gets a new number.",
        "distribution": [_file_object(file) for file in files],
        "recordSet": [_record_set(path, fields) for path, fields in columns.items()],
    }


def _file_object(file: PublishedFile) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": file.path,
        "name": file.path,
        "contentUrl": file.path,
        "contentSize": f"{file.size} B",
        "encodingFormat": file.kind,
        "sha256": file.sha256,
    }


def _record_set(path: str, fields: Mapping[str, str]) -> dict[str, Any]:
    name = path.removeprefix("index/").removesuffix(".parquet")
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": f"The pairs of {name}: in which shard and row, of which shapes.",
        "key": {"@id": f"{name}/pair_id"},
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"{name}/{column}",
                "name": column,
                "description": COLUMNS[column],
                "dataType": _TYPES.get(kind, "sc:Text"),
                "source": {"fileObject": {"@id": path}, "extract": {"column": column}},
            }
            for column, kind in fields.items()
        ],
    }


COLUMNS = {
    "pair_id": "random name of the pair, 16 hexadecimal digits",
    "shard": "number of the shard files that hold it",
    "row": "its row there",
    "env_shape": "shape of the environment",
    "obj_shape": "shape of the object",
    "env_category": "category of the environment",
    "obj_category": "category of the object",
    "label": "the object fits; train splits only",
}
"""The columns of a Parquet index."""
