"""The live view of the workbench with a running node, real DDS and a browser."""

import os
import re
import signal
import subprocess
import sys

from browser import ROOT, watched
from gravity_comp_ros.node.node_client import Status
from gravity_comp_ros.recordings.bag import read_bag
from gravity_comp_ros.workbench.live_view import age_html, status_html
import numpy as np
from ros_harness import running

PATIENCE = 180.0
STREAMED = """() => {
  let longest = 0
  for (const document of Bokeh.documents)
    for (const model of document._all_models.values())
      if (model.type == 'ColumnDataSource' && model.get_column('p6') != null)
        longest = Math.max(longest, model.get_column('t').length)
  return longest
}"""


def test_a_node_is_followed(iiwa_model_file):
    samples = read_bag(ROOT / 'bags' / 'eq17_unloaded.mcap').samples
    with running({'model_file': iiwa_model_file, 'stale_after': 10.0,
                  'max_torque': '[200.0]'}) as (_, probe):
        domain = str(probe.context.get_domain_id())
        process = subprocess.Popen(
            [sys.executable, '-m', 'gravity_comp_ros.cli', 'workbench', '--live', '--port', '0',
             '--no-browser'], stdout=subprocess.PIPE, text=True,
            env={**os.environ, 'ROS_DOMAIN_ID': domain, 'PYTHONPATH': os.pathsep.join(
                p for p in [str(ROOT), *sys.path] if p)})
        try:
            address = re.search(r'http://\S+/', process.stdout.readline())[0]
            with watched(address) as tab:
                tab.open(address)
                heading = tab.page.get_by_role('heading', name='Node /gravity_comp')
                heading.wait_for()
                probe.until(lambda: _has(tab, 'feed-forward'), PATIENCE, 'a status of the node')
                start = 0.0

                def followed() -> bool:
                    nonlocal start
                    probe.stream(samples.select(np.arange(100)), start)
                    start += 200.0
                    return tab.page.evaluate(STREAMED) > 90

                probe.until(followed, PATIENCE, 'rows on the page')
                tab.page.get_by_text('Events').first.wait_for()
                tab.wait_for_plots(14)
                assert len(tab.plots()) == 14
                tab.picture('workbench-live')
                # No more messages: the page shows the age of its data.
                age = tab.page.locator('#live-age')
                age.filter(has_text=re.compile(r'SILENT: last torque [2-9] s ago')).wait_for()
                assert 'error' in age.get_attribute('class')
                assert tab.complaints == []
            process.send_signal(signal.SIGINT)
            assert process.wait(PATIENCE) == 0
        finally:
            process.kill()
            process.wait(PATIENCE)
            process.stdout.close()


def test_a_silent_node_is_reported_with_stale_levels():
    statuses = [Status('input', 0, 'ok <b>'), Status('model', 2, 'residual too large')]
    fresh, old = status_html(statuses, 0.5), status_html(statuses, 18.0)
    assert '<span class="level ok">ok</span>' in fresh and 'ok &lt;b&gt;' in fresh
    assert '<span class="level error">error</span>' in fresh
    assert old.count('class="level stale"') == 2 and 'stale, was error' in old
    assert 'level ok' in age_html(0.1, 0.9) and 'less than 1 s ago' in age_html(0.1, 0.9)
    assert 'SILENT: last torque 18 s ago' in age_html(18.0, 0.5)
    assert 'SILENT' in age_html(0.1, 18.0) and 'no torque yet' in age_html(None, 0.5)


def _has(tab, message):
    return tab.page.get_by_role('row', name=re.compile(message)).count() > 0
