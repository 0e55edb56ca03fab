"""Every state that the model has been in: a tree, because one may go back and try otherwise."""

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
    One state of the model, with its held-out RMSE by joint in N·m, and how it came about.

    It was fitted, or read from the file `given`, or made from the stage number `parent` by adding
    `effects`, or by taking its last addition back (no effects). `choice` is what that was done
    with. `warnings` are about the model. `name` and `note` are the user's; `diagnosis` belongs to
    `judged_with`.
    """

    name: str
    model: GravityModel
    choice: Choice
    parent: int | None = None
    effects: tuple[str, ...] = ()
    given: Path | None = None
    held_out: Mapping[str, float] = field(default_factory=dict)
    diagnosis: Diagnosis | None = None
    judged_with: Choice | None = None
    note: str = ''
    warnings: tuple[str, ...] = ()


def path_to(stages: list[Stage], number: int) -> list[int]:
    """Return the numbers of the stages from the first one to this."""
    way, at = [number], stages[number].parent
    while at is not None:
        way.append(at)
        at = stages[at].parent
    return way[::-1]


def depth(stages: list[Stage], number: int) -> int:
    """Return how many stages lie before this one on its branch."""
    return len(path_to(stages, number)) - 1


def command_lines(stages: list[Stage], number: int, bags: tuple[Path, ...],
                  topic: str | None) -> list[str]:
    """
    Return command lines that make the same model, to the last digit.

    :param bags: all recordings; each stage's choice says which of them it used.
    """
    return [_command(stages[k], bags, topic) for k in path_to(stages, number)]


def reports(choice: Choice, bags: tuple[Path, ...], topic: str | None) -> list[str]:
    """Return command lines that judge the model as the page does."""
    files = _files(choice, bags)
    reading = choice.reading_words(topic, joints=False)
    return [line('gravity_comp', 'compare', *files, '--model', MODEL_FILE, *reading,
                 *choice.gate_words()),
            line('gravity_comp', 'diagnose', *files, '--model', MODEL_FILE, *reading, '--html',
                 'report.html')]


def add_command(effects: tuple[str, ...], choice: Choice, bags: tuple[Path, ...],
                topic: str | None) -> str:
    """Return the command line that adds effects."""
    return line('gravity_comp', 'add', ','.join(effects), '--model', MODEL_FILE,
                *_files(choice, bags), *choice.reading_words(topic, joints=False),
                *choice.gate_words())


def _command(stage: Stage, bags: tuple[Path, ...], topic: str | None) -> str:
    if stage.given is not None:
        return line('cp', str(stage.given.resolve()), MODEL_FILE)
    if stage.parent is None:
        choice = stage.choice
        return line('gravity_comp', 'fit', *_files(choice, bags), *choice.learning_words(),
                    *choice.reading_words(topic), *choice.gate_words(), '-o', MODEL_FILE)
    if not stage.effects:
        return line('gravity_comp', 'add', '--undo', '--model', MODEL_FILE)
    return add_command(stage.effects, stage.choice, bags, topic)


def _files(choice: Choice, bags: tuple[Path, ...]) -> list[str]:
    # The command lines are run from any folder.
    return [str(bags[run].resolve()) for run in choice.runs]


def warnings_of_fit(answer: Learned) -> tuple[str, ...]:
    """Return what is doubtful of a fitted model."""
    axes = answer.arm.axes
    found = [*answer.result.report.warnings]
    if axes.problem:
        found.append(f'{axes.problem}.')
    if axes.left_out:
        found.append(f'Left out, because it is no part of the arm: {", ".join(axes.left_out)}.')
    return tuple(found)
