"""History of a model's effects and payload updates, and undo of the last change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime, UTC

from gravity_comp_ros.errors import DataError
from gravity_comp_ros.models.gravity_model import ADDED, GravityModel, REMOVED, Step


def with_step(model: GravityModel, previous: GravityModel, effects: tuple[str, ...], when: str,
              before: Mapping[str, float], after: Mapping[str, float],
              action: str = ADDED) -> GravityModel:
    """Return a model with the step from the `previous` model appended to its history."""
    # The previous model is stored without its own history, which would nest.
    step = Step(action, effects, when, before, after, replace(previous, history=()))
    return replace(model, history=(*previous.history, step))


def undone(model: GravityModel, when: str) -> GravityModel:
    """
    Return the model before the last addition or update; the history records both.

    :raises DataError: if there is nothing to undo, or the model before it does not include a
        later payload change.
    """
    history = model.history
    place = next((k for k in reversed(range(len(history))) if history[k].previous), None)
    if place is None:
        raise DataError('there is no addition to undo' + (
            '; it was undone already' if history else ''))
    step, previous = history[place], history[place].previous
    assert previous is not None
    if step.action == ADDED and _updates(previous) != _updates(model):
        raise DataError(f'the payload changed after {", ".join(step.effects)} had been added, and '
                        f'the model before does not include it; fit again without the effect')
    kept = (*history[:place], replace(step, previous=None), *history[place + 1:])
    back = Step(REMOVED, step.effects, when, step.after, step.before)
    return replace(previous, history=(*kept, back))


def _updates(model: GravityModel) -> int:
    return len(model.provenance.get('updates', ()))


def now() -> str:
    """Return the current UTC time in ISO 8601 format."""
    return datetime.now(UTC).isoformat(timespec='seconds')
