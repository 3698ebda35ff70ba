"""Digests of a data set's files, beside them: LeRobot's formats have no place for any; parquet protects only pages."""

from pathlib import Path, PurePosixPath

from mimicbench.core.errors import BadFile
from mimicbench.core.files import digest_of, read_record, write_record

DIGESTS = Path("meta") / "digests.json"
_FILES = ("data/*/*.parquet", "meta/episodes/*/*.parquet", "meta/*.parquet", "meta/*.json")


def write_digests(folder: Path) -> None:
    """Write what stands for each file of a data set; files whose digest is known are not read again.

    Those of the data set as a whole (`meta/*`) change with every shard, shards never.
    """
    known = read_digests(folder) if (folder / DIGESTS).exists() else {}
    shards = {name: digest for name, digest in known.items() if name.count("/") > 1}
    names = sorted(
        str(path.relative_to(folder))
        for pattern in _FILES
        for path in folder.glob(pattern)
        if path.relative_to(folder) != DIGESTS and _is_whole(folder, path)
    )
    write_record(folder / DIGESTS, {name: shards.get(name) or digest_of(folder / name) for name in names})


def _is_whole(folder: Path, path: Path) -> bool:
    """Whether a file is of a shard that has its episodes, too: one that has not will be written again."""
    place = path.relative_to(folder)
    return place.parts[0] != "data" or (folder / "meta" / "episodes" / Path(*place.parts[1:])).exists()


def read_digests(folder: Path) -> dict[str, str]:
    """File -> digest. Raises BadFile."""
    return read_record(folder / DIGESTS)


def check_digests(folder: Path) -> None:
    """Raise BadFile for the first file of a data set that is not as it was written; others' data sets have no digests
    to check.
    """
    if not (folder / DIGESTS).exists():
        return
    for name, digest in read_digests(folder).items():
        # who wrote this may be a stranger: nothing leads out of the folder, and nothing is read that is not a file
        place = PurePosixPath(name)
        inside = not place.is_absolute() and ".." not in place.parts and any(map(place.match, _FILES))
        if not inside or not (folder / name).is_file() or digest_of(folder / name) != digest:
            raise BadFile(
                f"{folder / name} is not as it was written; it is damaged: delete the folder of these "
                "demonstrations, and run `mimicbench demos` again"
            )
