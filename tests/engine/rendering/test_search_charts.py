"""The chart of a study says what was tried, what each change brings, and what matters."""

from pathlib import Path

from plannerforge.engine.execution import silent
from plannerforge.engine.rendering import render
from plannerforge.schemas.analysis.optimization import ChangeShare, Effect, StudyRecord, TrialLine
from plannerforge.schemas.planning import WeightChange
from plannerforge.schemas.rendering import RenderRequest


def _study() -> StudyRecord:
    trials = tuple(
        TrialLine(
            number=number,
            config_id=f"cfg_{number}",
            name="",
            values=(0.5 + 0.02 * number,),
            runs=9,
            pruned=number == 2,
            within=True,
        )
        for number in range(4)
    )
    return StudyRecord(
        study_id="study_1",
        method="tpe",
        objective=("success",),
        constraints=(),
        prediction="constant_velocity",
        traffic="recorded",
        base_id="cfg_0",
        base_name="idm:Default",
        best_id="cfg_3",
        best_name="idm:Default [a=2]",
        training_scenarios=9,
        training=("DEU_A",),
        held_out_places=("DEU_B",),
        trials=trials,
        changes=(ChangeShare(change=WeightChange(name="jerk", before=0, after=2), gain=0.06),),
    )


def _drawn(study: StudyRecord, folder: Path) -> str:
    made = render(RenderRequest(kind="auto", study=study, folder=str(folder)), silent)
    assert made.images[0].size_bytes > 1000
    return made.images[0].alt_text


def test_a_search_is_drawn_with_its_best_candidate_and_the_gain_of_changes(tmp_path: Path) -> None:
    words = _drawn(_study(), tmp_path)
    assert "the base has 0.500, the best 0.560" in words
    assert "jerk from 0 to 2 brings 0.060" in words


def test_a_search_without_improvement_says_so_in_the_chart(tmp_path: Path) -> None:
    assert "Nothing better was found" in _drawn(_study().model_copy(update={"changes": ()}), tmp_path)


def test_effects_are_drawn_with_their_verdicts(tmp_path: Path) -> None:
    effects = (
        Effect(name="jerk", effect=0.4, margin=0.1, verdict="matters"),
        Effect(name="velocity", effect=0.0, margin=0.0, verdict="none"),
    )
    words = _drawn(_study().model_copy(update={"effects": effects, "method": "morris"}), tmp_path)
    assert "jerk 0.4 (matters); velocity 0 (none)" in words
