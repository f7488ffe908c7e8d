"""The workspace: immutable artifacts, their recipes, and the database that knows them.

``ARTIFACT_KINDS``: The names of all kinds of artifacts.
``STARTER_TOOL``: Stands in recipes in the place of a tool where a scenario came with the package.
``VIEWED_KINDS``: The kinds of artifacts that have a view.
``Artifact``: What was made: id, kind, recipe and record; its files lie in the workspace.
``NewArtifact``: An artifact that is to be stored, with the files to copy.
``ArtifactKind``: The kinds of artifacts.
``Workspace``: One folder with everything that was made.
``disk_failure``: The error of a file or folder that cannot be written, by default one of the workspace.
``stage``: Copy the files of an artifact into a new folder, before the database is locked.
``write_text``: Writes a text file, or raises the error of a full disk.
``Database``: Access to the workspace's SQLite file.
``stored_json``: A JSON value of the database, or the error that names it if it is nested too deeply.
``make_private``: Make a folder that nobody else on the machine may look into.
``still_runs``: Whether the process ``pid`` that wrote something at ``since`` (seconds since 1970) is still there.
``Export``: One file to write for an export: artifact, format, path.
``REPORT_NAME``: The file name of a report in the export folder.
``plan_exports``: The files that an export has to write.
``refuse_taken``: Raise before anything is written where a file is there already.
``write_export``: Write one file of an export whole.
``write_whole``: Have a file written under a free name, then give it its own: no link or pipe is written through.
``content_digest``: SHA-256 of a file, hexadecimal.
``Recipe``: The tool, its resolved arguments, the artifacts it started from, the seed, and the versions that matter.
``versions_of``: The installed versions of packages, and our own, for a recipe.
``room_used``: What each part of the workspace takes.
``disagreements``: What does not fit together in a workspace.
``repair``: Takes out artifacts whose record calls cannot read or believe.
``make_room``: Removes what belongs to nothing, and above a quota what can be made again.
``Quota``: What a workspace may take, asked before something is stored.
``export_workspace``: Writes all artifacts with their files into one archive.
``import_workspace``: Takes in what an archive holds, whole or not at all.
``ArchiveLimits``: What an archive may hold at most.
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
        disk_failure,
        stage,
        write_text,
    )
    from .database import Database, make_private, still_runs, stored_json
    from .export import REPORT_NAME, Export, plan_exports, refuse_taken, write_export, write_whole
    from .recipe import Recipe, content_digest, versions_of
    from .upkeep import Quota, disagreements, make_room, repair, room_used

__getattr__, __dir__ = lazy_face(__name__, __file__)
