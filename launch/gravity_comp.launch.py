"""Launch the node: `ros2 launch gravity_comp_ros gravity_comp.launch.py params_file:=my.yaml`."""

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Return the launch arguments and the node."""
    share = get_package_share_directory('gravity_comp_ros')
    arguments = [
        DeclareLaunchArgument(
            'params_file',
            default_value=PathJoinSubstitution([share, 'config', 'gravity_comp.yaml']),
            description='Parameters of the node.'),
        DeclareLaunchArgument(
            'namespace', default_value='',
            description='Namespace of the node and its topics; one for each arm.'),
        DeclareLaunchArgument(
            'joint_states', default_value='joint_states',
            description='Topic of the joint states; in the namespace unless it begins with /.'),
        DeclareLaunchArgument(
            'commands', default_value='~/commands',
            description='Topic of the torques: the command topic of the controller.'),
        DeclareLaunchArgument(
            'respawn', default_value='true', choices=['true', 'false'],
            description='Start the node again after it has ended with an error.'),
        DeclareLaunchArgument(
            'use_sim_time', default_value='false', choices=['true', 'false'],
            description='Use the time of /clock.'),
    ]
    node = Node(
        package='gravity_comp_ros', executable='gravity_comp_node', name='gravity_comp',
        namespace=LaunchConfiguration('namespace'), output='screen', emulate_tty=True,
        respawn=LaunchConfiguration('respawn'), respawn_delay=2.0,
        parameters=[LaunchConfiguration('params_file'),
                    {'use_sim_time': LaunchConfiguration('use_sim_time')}],
        remappings=[('joint_states', LaunchConfiguration('joint_states')),
                    ('~/commands', LaunchConfiguration('commands'))])
    return LaunchDescription([*arguments, node])
