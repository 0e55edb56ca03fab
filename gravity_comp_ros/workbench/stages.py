"""Stages of the model: a tree of all its states, with the command lines that reproduce them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from gravity_comp_ros.api.learn import Learned
from gravity_comp_ros.diagnosis.findings import Diagnosis
from gravity_comp_ros.models.gravity_model import GravityModel
from gravity_comp_ros.workbench.choice import Choice, line

MODEL_FILE = 'arm.json'


@dataclass(frozen=True)
class Stage:
    """
    One state of the model, with its held-out RMSE by joint in N·m and its origin.

    A stage is a fit, or a model read from the file `given`, or the stage number `parent` with
    added `effects`, or with its last addition removed (no effects). `choice` has the settings of
    that step. `warnings` are about the model. `name` and `note` are set by the user. `diagnosis`
    was made with the settings `diagnosed_with`.
    """

    name: str
    model: GravityModel
    choice: Choice
    parent: int | None = None
    effects: tuple[str, ...] = ()
    given: Path | None = None
    held_out: Mapping[str, float] = field(default_factory=dict)
    diagnosis: Diagnosis | None = None
    diagnosed_with: Choice | None = None
    note: str = ''
    warnings: tuple[str, ...] = ()


def path_to(stages: list[Stage], number: int) -> list[int]:
    """Return the numbers of the stages from the root to this one."""
    path, parent = [number], stages[number].parent
    while parent is not None:
        path.append(parent)
        parent = stages[parent].parent
    return path[::-1]


def depth(stages: list[Stage], number: int) -> int:
    """Return the number of stages before this one on its branch."""
    return len(path_to(stages, number)) - 1


def command_lines(stages: list[Stage], number: int, bags: tuple[Path, ...],
                  topic: str | None) -> list[str]:
    """
    Return command lines that reproduce the model exactly.

    :param bags: all recordings; the choice of each stage selects among them.
    """
    return [_command(stages[k], bags, topic) for k in path_to(stages, number)]


def reports(choice: Choice, bags: tuple[Path, ...], topic: str | None) -> list[str]:
    """Return command lines for the comparison and the diagnosis of the page."""
    files = _files(choice, bags)
    reading = choice.reading_options(topic, joints=False)
    return [line('gravity_comp', 'compare', *files, '--model', MODEL_FILE, *reading,
                 *choice.gate_options()),
            line('gravity_comp', 'diagnose', *files, '--model', MODEL_FILE, *reading, '--html',
                 'report.html')]


def add_command(effects: tuple[str, ...], choice: Choice, bags: tuple[Path, ...],
                topic: str | None) -> str:
    """Return the command line that adds effects."""
    return line('gravity_comp', 'add', ','.join(effects), '--model', MODEL_FILE,
                *_files(choice, bags), *choice.reading_options(topic, joints=False),
                *choice.gate_options())


def _command(stage: Stage, bags: tuple[Path, ...], topic: str | None) -> str:
    if stage.given is not None:
        return line('cp', str(stage.given.resolve()), MODEL_FILE)
    if stage.parent is None:
        choice = stage.choice
        return line('gravity_comp', 'fit', *_files(choice, bags), *choice.fit_options(),
                    *choice.reading_options(topic), *choice.gate_options(), '-o', MODEL_FILE)
    if not stage.effects:
        return line('gravity_comp', 'add', '--undo', '--model', MODEL_FILE)
    return add_command(stage.effects, stage.choice, bags, topic)


def _files(choice: Choice, bags: tuple[Path, ...]) -> list[str]:
    # Absolute paths, so that the command lines run in any folder.
    return [str(bags[run].resolve()) for run in choice.runs]


def warnings_of_fit(answer: Learned) -> tuple[str, ...]:
    """Return the warnings on a fitted model."""
    axes = answer.arm.axes
    warnings = [*answer.result.report.warnings]
    if axes.problem:
        warnings.append(f'{axes.problem}.')
    if axes.left_out:
        warnings.append(f'Omitted, because not part of the arm: {", ".join(axes.left_out)}.')
    return tuple(warnings)
