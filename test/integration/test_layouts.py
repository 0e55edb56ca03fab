"""Layouts for PlotJuggler and Foxglove: plotted topics exist in the node and in `replay`."""

from importlib import import_module
import json
from pathlib import Path
import re
from xml.etree import ElementTree

from gravity_comp_ros.cli import main
from gravity_comp_ros.recordings.bag import read_bag, ReadOptions
import pytest

ROOT = Path(__file__).resolve().parents[2]
LAYOUTS = ROOT / 'config' / 'layouts'
LIVE_ONLY = {'/gravity_comp/gravity_torques', '/gravity_comp/extrapolation'}
MESSAGE_PATH = re.compile(r'(/[\w/]+)\.(position|velocity|effort)\[(\d+)\]')


def curves():
    """Return (topic, joint, field) of every curve of the PlotJuggler layout."""
    root = ElementTree.parse(LAYOUTS / 'plotjuggler.xml').getroot()
    return [tuple(curve.get('name').rsplit('/', 2)) for curve in root.iter('curve')]


def paths():
    """Return (topic, field, index) of every path of the Foxglove layout."""
    panels = json.loads((LAYOUTS / 'foxglove.json').read_text())['configById']
    return [MESSAGE_PATH.fullmatch(path['value']).groups()
            for panel in panels.values() for path in panel.get('paths', [])]


def check(topics):
    """Check that each plotted field of each topic exists; `topics`: name -> message."""
    names = {name: list(message.name) for name, message in topics.items()}
    plotted = [curve for curve in curves() if curve[0] in topics]
    assert {topic for topic, _, _ in plotted} == set(topics)
    for topic, joint, field in plotted:
        assert len(getattr(topics[topic], field)) > names[topic].index(joint)
    for topic, field, index in paths():
        if topic in topics:
            assert len(getattr(topics[topic], field)) > int(index)


class LastMessage:
    """The last row of a topic of a bag, with the attributes of a message."""

    def __init__(self, path, topic):
        # A prediction is not a measured effort: it has no friction whose sign could be checked.
        samples = read_bag(path, ReadOptions(topic=topic, refuse=False)).samples
        self.name, self.position = samples.names, samples.q[-1]
        self.effort, self.velocity = samples.tau[-1], samples.qd[-1]


def test_plotted_topics_are_in_the_output_of_replay(iiwa_model_file, tmp_path):
    out = tmp_path / 'out.mcap'
    assert main(['replay', str(ROOT / 'bags' / 'eq17_later.mcap'), '--model',
                 str(iiwa_model_file), '-o', str(out)]) == 0
    everything = {topic for topic, _, _ in curves()} | {topic for topic, _, _ in paths()}
    check({topic: LastMessage(out, topic) for topic in everything - LIVE_ONLY})
    outputs = pytest.importorskip('gravity_comp_ros.node.outputs')
    assert LIVE_ONLY <= everything & {f'/gravity_comp/{topic}' for topic in outputs.JOINT_TOPICS}


def test_layouts_are_up_to_date(tmp_path):
    make_layouts = import_module('config.layouts.make_layouts')
    make_layouts.main(['--folder', str(tmp_path)])
    for name in ('plotjuggler.xml', 'foxglove.json'):
        assert (tmp_path / name).read_text() == (LAYOUTS / name).read_text()
    make_layouts.main(['shoulder', 'elbow', '--folder', str(tmp_path),
                       '--joint-states', '/arm/joint_states'])
    text = (tmp_path / 'plotjuggler.xml').read_text()
    assert 'name="/arm/joint_states/elbow/effort"' in text and 'iiwa' not in text
