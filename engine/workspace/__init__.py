"""The workspace: immutable artifacts, their recipes, and the database that knows them.

``Artifact``: What was made: id, kind, recipe and record; its files lie in the workspace.
``NewArtifact``: An artifact that is to be stored, with the files to copy.
``Staged``: A new artifact and the folder with the copies of its files.
``Workspace``: One folder with everything that was made.
``artifact_kinds``: The names of all kinds of artifacts.
``disk_failure``: The error of a workspace that cannot be written.
``stage``: Copy the files of artifacts into subfolders of a scratch folder.
``write_text``: Writes a text file, or raises the error of a full disk.
``Database``: Access to the workspace's SQLite file.
``still_runs``: Whether the process ``pid`` that wrote something at ``since`` (seconds since 1970) is still there.
``Export``: One file to write for an export: artifact, format, path.
``REPORT_NAME``: The file name of a report in the export folder.
``plan_exports``: The files that an export has to write.
``refuse_taken``: Raise before anything is written where a file is there already.
``write_export``: Write one file whole.
``content_digest``: SHA-256 of a file, hexadecimal.
``Recipe``: The tool, its resolved arguments, the artifacts it started from, the seed, and the versions that matter.
``versions_of``: The installed versions of packages, and our own, for a recipe.
"""

from typing import TYPE_CHECKING

from .. import lazy_face

if TYPE_CHECKING:
    from .artifacts import Artifact, NewArtifact, Staged, Workspace, artifact_kinds, disk_failure, stage, write_text
    from .database import Database, still_runs
    from .export import REPORT_NAME, Export, plan_exports, refuse_taken, write_export
    from .recipe import Recipe, content_digest, versions_of

__getattr__, __dir__ = lazy_face(__name__, __file__)
