#!/usr/bin/env bash
# A backup of the data folder of a service with SQLite, which may run meanwhile:
#
#   scripts/backup-folder.sh FOLDER BACKUP
#
# The rows first, then what they name: bytes without a row are harmless, rows without bytes are not. BACKUP is a folder
# that does not exist; it is restored by copying it to the place of the data folder. Needs python3.
set -euo pipefail

from=${1:?the data folder}
to=${2:?where the backup goes}
[ -f "$from/meshway.db" ] || { echo "backup-folder: $from has no meshway.db" >&2; exit 1; }
umask 077
mkdir "$to"
python3 - "$from" "$to" <<'PYTHON'
import pathlib
import shutil
import sqlite3
import sys

source, target = map(pathlib.Path, sys.argv[1:])


def database(name):
    """A snapshot, for which no writer waits."""
    read, write = (sqlite3.connect(folder / name, timeout=60) for folder in (source, target))
    read.backup(write)
    write.close()
    read.close()


def files(pattern):
    for file in source.glob(pattern):
        copy = target / file.relative_to(source)
        copy.parent.mkdir(exist_ok=True)
        try:
            shutil.copy2(file, copy)
        except FileNotFoundError:
            # It was erased meanwhile.
            copy.unlink(missing_ok=True)


database("meshway.db")
for pattern in ("meshway-folder", "home", "clouds/*", "uploads/*"):
    files(pattern)
if (source / "content.db").exists():
    database("content.db")
PYTHON
