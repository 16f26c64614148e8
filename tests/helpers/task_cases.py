"""A small study of every task: practice to a criterion, catch trials, a break, questions."""

from dataclasses import dataclass

from study_texts import files_recipe, short_study

ROUND, ROUNDS, CATCH = 4, 3, 2
STIMULI = files_recipe(
    {
        f"{scene}-{method}-{level}": {"scene": scene, "method": method, "level": level}
        for scene in "abc"
        for method in ("one", "two")
        for level in (1, 2)
    }
)
DESIGN = f"""
repeats = 1
blocks = 2
break_s = 7.0
practice = {{ trials = {ROUND}, feedback = true, criterion_share = 0.75, rounds_max = {ROUNDS} }}
"""
TRIAL = "fixation_s = 0.1\niti_s = 0.1\nfeedback_s = 0.2"
QUESTIONS = """
[[text.languages.en.questions]]
name = "strategy"
text = "What did you look at?"
[[text.languages.en.questions]]
name = "glasses"
text = "Do you wear glasses?"
choices = ["no", "yes"]
"""
PAIR_CATCH = (
    f'catch = {{ trials = {CATCH}, better = "one", worse = "two", where = {{ level = 2 }} }}'
)
EASY_CATCH = f"catch = {{ trials = {CATCH}, where = {{ level = 2 }} }}"
UP_DOWN = (
    'adaptive = { rule = "up-down", trials = 12, column = "level", start = 2.0,'
    " harder = [1.0], easier = [1.0] }"
)


@dataclass(frozen=True)
class Case:
    task: str
    answers: tuple[str, ...]
    analysis: str
    main: int
    """Main trials of a session."""
    design: str = DESIGN


PREFERENCE = 'kind = "preference"\nprimary = { method = "one", against = "two" }'
YES_NO = f'kind = "yes-no"\nstimulus_s = 0.1\nsignal = {{ method = ["two"] }}\n{EASY_CATCH}'
CASES = {
    "two-interval": Case(
        f'kind = "two-interval"\nstimulus_s = 0.1\ngap_s = 0.1\n{PAIR_CATCH}',
        ("first", "second"), PREFERENCE, 6,
    ),
    "two-alternative": Case(
        f'kind = "two-alternative"\nstimulus_s = 0.1\nseparation_deg = 6.0\n{PAIR_CATCH}',
        ("left", "right"), PREFERENCE, 6,
    ),
    "yes-no": Case(YES_NO, ("yes", "no"), 'kind = "detection"', 12),
    "identification": Case(
        'kind = "identification"\nstimulus_s = 0.1\nalternatives = ["one", "two"]\n'
        f'named_by = "method"\n{EASY_CATCH}',
        ("one", "two"), 'kind = "identification"\nby = "level"', 12,
    ),
    "abx": Case(
        'kind = "abx"\nstimulus_s = 0.1\ngap_s = 0.1\nstandard = { method = "one" }\n'
        f'matched = ["scene", "level"]\n{EASY_CATCH}',
        ("a", "b"), 'kind = "abx"\nby = "level"', 6,
    ),
    "which-half": Case(
        'kind = "which-half"\nstimulus_s = 0.1\ngap_s = 0.1\nstandard = { method = "one" }\n'
        f'matched = ["scene", "level"]\n{EASY_CATCH}',
        ("left", "right"), 'kind = "which-half"\nby = "level"', 6,
    ),
    "yes-no by up-down": Case(
        f"{YES_NO}\n{UP_DOWN}", ("yes", "no"), 'kind = "detection"\nlevel = "level"', 12
    ),
}  # fmt: skip


def case_text(case: Case) -> str:
    """Return the study file of a case."""
    return short_study(
        stimuli=STIMULI,
        task=case.task,
        answers=case.answers,
        analysis=case.analysis,
        design=case.design,
        trial=TRIAL,
        texts=QUESTIONS,
    )
