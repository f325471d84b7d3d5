"""The views show every topic that can be displayed, under its name and with a matching QoS."""
import json

import yaml

from dragon_ros import configuration
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import stamp_at_of
from dragon_ros.messages.markers import BENCH_HEIGHT_M

CLASS = {'Marker': 'visualization_msgs/msg/Marker', 'MarkerArray': 'visualization_msgs/msg/MarkerArray',
         'PoseArray': 'geometry_msgs/msg/PoseArray', 'PointStamped': 'geometry_msgs/msg/PointStamped'}
SEEN = {f'/dragon/{name}' for name, channel in channels().items() if channel.type in CLASS.values()}


def test_rviz_shows_every_topic_that_can_be_seen_with_its_own_type_and_durability():
    view = yaml.safe_load((configuration.folder() / 'rviz' / 'dragon.rviz').read_text())['Visualization Manager']
    assert view['Global Options']['Fixed Frame'] == 'dragon'
    shown = {display['Topic']['Value']: display for display in view['Displays'] if 'Topic' in display}
    assert set(shown) == SEEN
    for topic, display in shown.items():
        channel = channels()[topic.removeprefix('/dragon/')]
        assert display['Enabled']
        assert CLASS[display['Class'].split('/')[1]] == channel.type
        durability = display['Topic']['Durability Policy'].lower().replace(' ', '_')
        assert durability == channel.durability


def test_foxglove_shows_them_too_with_plots_and_health_and_every_panel_is_laid_out():
    layout = json.loads((configuration.folder() / 'foxglove' / 'dragon.json').read_text())
    panels = layout['configById']
    assert {topic for topic, row in panels['3D!dragon']['topics'].items() if row['visible']} == SEEN
    paths = [path for panel in panels.values() for path in panel.get('paths', []) if path['value'] != '0']
    rest = [path['value'].split('.')[0] for path in paths]
    rest += [panel['topicToRender'] for panel in panels.values() if 'topicToRender' in panel]
    assert set(rest) == {'/dragon/clearance/stamped', '/dragon/velocities', '/dragon/collision', '/diagnostics'}
    stamped = {path['value'].split('.')[0]: path['timestampMethod'] == 'headerStamp' for path in paths}
    assert stamped == {name: stamp_at_of(channels()[name.removeprefix('/dragon/')].type) is not None
                       for name in stamped}

    assert 'followTf' not in panels['3D!dragon']        # with followTf, Lichtblick logs errors at each jump back
    arrows = panels['3D!dragon']['topics']['/dragon/handles']['arrowScale']
    assert min(arrows) > BENCH_HEIGHT_M       # so that the benches do not hide the arrows
    plots = [panel for name, panel in panels.items() if name.startswith('Plot!')]
    assert all(panel['foxglovePanelTitle'] == panel['lichtblickPanelTitle'] for panel in plots)

    def leaves(part):
        return {part} if isinstance(part, str) else leaves(part['first']) | leaves(part['second'])
    assert leaves(layout['layout']) == set(panels)
