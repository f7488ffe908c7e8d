"""The workspace: immutable artifacts, their recipes, and the database that indexes them.

``ARTIFACT_KINDS``: The names of all kinds of artifacts.
``STARTER_TOOL``: The name that replaces the tool in the recipes of scenarios from the package.
``VIEWED_KINDS``: The kinds of artifacts that have a view.
``Artifact``: A stored artifact: id, kind, recipe and record; its files are in the workspace.
``NewArtifact``: An artifact to store, with the files to copy.
``ArtifactKind``: The kinds of artifacts.
``Workspace``: A folder with all stored artifacts.
``append_text``: Appends to a text file, or raises the error of a full disk.
``disk_failure``: Returns the error of a file or folder that cannot be written, by default one of the workspace.
``stage``: Copies the files of an artifact into a new folder, before the database is locked.
``write_text``: Writes a text file, or raises the error of a full disk.
``Database``: Access to the workspace's SQLite file.
``stored_json``: Returns a JSON value of the database, or raises the error of one that is nested too deeply.
``make_private``: Creates a folder that only this user can read.
``still_runs``: Returns True if the process ``pid`` that wrote something at ``since`` is still running.
``Export``: One file to write for an export: artifact, format, path.
``REPORT_NAME``: The file name of a report in the export folder.
``plan_exports``: Returns the files that an export must write.
``refuse_existing``: Raises if a file exists, before anything is written.
``refuse_file``: Raises if a folder for files is a file.
``write_export``: Writes one file of an export as a whole.
``write_whole``: Writes a file under a free name and then renames it, so that it follows no link or pipe.
``content_digest``: Returns the SHA-256 of a file in hexadecimal.
``Recipe``: The tool, its resolved arguments, the parent artifacts, the seed, and the relevant versions.
``versions_of``: Returns the installed versions of packages, and our own, for a recipe.
``room_used``: Returns the size of each part of the workspace.
``disagreements``: Yields the inconsistencies of a workspace.
``repair``: Removes artifacts with unreadable or inconsistent records.
``make_room``: Removes what belongs to no record and, above a quota, what can be recreated.
``Quota``: The size limit of a workspace, which is checked before something is stored.
``export_workspace``: Writes all artifacts with their files into one archive.
``import_workspace``: Imports an archive, either as a whole or not at all.
``ArchiveLimits``: The limits of an archive.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .archive import ArchiveLimits, export_workspace, import_workspace
    from .artifacts import (
        ARTIFACT_KINDS,
        STARTER_TOOL,
        VIEWED_KINDS,
        Artifact,
        ArtifactKind,
        NewArtifact,
        Workspace,
        append_text,
        disk_failure,
        stage,
        write_text,
    )
    from .database import Database, make_private, still_runs, stored_json
    from .export import REPORT_NAME, Export, plan_exports, refuse_existing, refuse_file, write_export, write_whole
    from .recipe import Recipe, content_digest, versions_of
    from .upkeep import Quota, disagreements, make_room, repair, room_used

__getattr__, __dir__ = lazy_face(__name__, __file__)
