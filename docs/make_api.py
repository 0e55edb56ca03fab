"""
Generation of the Python API pages from docstrings, with pdoc.

    python docs/make_api.py [FOLDER]      writes index.html and its pages, by default to docs/api

The pages are not under version control. A test checks that they include every public name.
"""

from pathlib import Path
import sys

import gravity_comp_ros
import pdoc

HERE = Path(__file__).resolve().parent
# Modules of the public functions and results; internal modules are documented in the source.
MODULES = ('gravity_comp_ros', 'gravity_comp_ros.api.loop', 'gravity_comp_ros.api.recording',
           'gravity_comp_ros.api.model', 'gravity_comp_ros.api.steps',
           'gravity_comp_ros.evaluation.compare',
           'gravity_comp_ros.planning.expected', 'gravity_comp_ros.planning.workspace',
           'gravity_comp_ros.diagnosis.findings', 'gravity_comp_ros.data.samples',
           'gravity_comp_ros.data.gate', 'gravity_comp_ros.errors')


def make(folder: Path) -> None:
    """Write the pages into a folder."""
    for name in gravity_comp_ros.__all__:
        getattr(gravity_comp_ros, name)  # pdoc includes only names that are imported
    pdoc.render.configure(docformat='restructuredtext', show_source=False, math=False)
    pdoc.pdoc(*MODULES, output_directory=folder)


if __name__ == '__main__':
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / 'api')
