"""Generator of docs/parameters.md from the parameter table."""

from __future__ import annotations

from gravity_comp_ros.node.parameters import TABLE, Value


def markdown() -> str:
    """Return docs/parameters.md."""
    lines = [
        '# Parameters of the node', '',
        'To configure the [node](node.md): `--ros-args --params-file my.yaml`, or `ros2 param '
        'set` for those that are not marked *at start*. A value out of range or of the wrong type '
        'is refused with the reason. Generated from `gravity_comp_ros/node/parameters.py` by '
        '`python3 docs/make_parameters.py > docs/parameters.md`.', '',
        '| parameter | type | default | range | unit | | meaning |',
        '|---|---|---|---|---|---|---|']
    for row in TABLE:
        lines.append(
            f'| `{row.name}` | {row.kind} | {_markdown_value(row.default)} | {row.range_text()} | '
            f'{row.unit} | {"*at start*" if row.read_only else ""} | {row.description} |')
    return '\n'.join(lines) + '\n'


def _markdown_value(value: Value) -> str:
    if isinstance(value, tuple):
        return '`[' + ', '.join(str(item) for item in value) + ']`'
    if isinstance(value, bool):
        return f'`{str(value).lower()}`'
    return f'`{value}`' if value != '' else '(empty)'


if __name__ == '__main__':
    print(markdown(), end='')
