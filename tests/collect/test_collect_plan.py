"""The plan depends on the seed alone, and its shares are exact."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from stages.collect.config import CollectConfig
from stages.collect.plan import Stream, frames_per_episode, plan_episodes


def test_paper_scale() -> None:
    plans = plan_episodes(CollectConfig(), "scripted")
    assert Counter(plan.behaviour for plan in plans) == {"random": 640, "scripted": 960}
    assert Counter(plan.split for plan in plans) == {"train": 1280, "validation": 160, "test": 160}
    assert Counter(plan.task for plan in plans) == {"reach": 800, "lift": 800}
    assert sum(len(plan.kept_steps) for plan in plans) == 80_000
    assert Counter(plan.leaning for plan in plans) == {True: 1200, False: 400}
    assert Counter(plan.spread for plan in plans) == {1.8: 800, 1.0: 800}


@given(
    episodes=st.integers(3, 60),
    steps=st.integers(1, 50),
    keep=st.floats(0.01, 1),
    validation=st.floats(0.01, 0.49),
    test=st.floats(0.01, 0.49),
    seed=st.integers(0, 2**31 - 1),
)
def test_every_share_is_kept(episodes: int, steps: int, keep: float, validation: float, test: float, seed: int) -> None:
    config = CollectConfig(
        episodes=episodes,
        steps=steps,
        keep_fraction=keep,
        validation_fraction=validation,
        test_fraction=test,
        seed=seed,
    )
    plans = plan_episodes(config, "scripted")
    assert [plan.episode for plan in plans] == list(range(episodes))
    assert {plan.split for plan in plans} == {"train", "validation", "test"}
    assert sum(plan.behaviour == "random" for plan in plans) == round(0.4 * episodes)
    for plan in plans:
        assert len(plan.kept_steps) == frames_per_episode(config)
        assert list(plan.kept_steps) == sorted(set(plan.kept_steps))
        assert 0 <= plan.kept_steps[0] <= plan.kept_steps[-1] < steps


def test_leaning_and_straying_are_drawn_apart_from_each_other_and_from_behaviours() -> None:
    kinds = Counter((plan.behaviour, plan.leaning, plan.spread) for plan in plan_episodes(CollectConfig(), "scripted"))
    assert len(kinds) == 8
    assert min(kinds.values()) > 40  # expected: at least 80 of 1600


def test_two_episodes_are_not_split() -> None:
    plans = plan_episodes(CollectConfig(episodes=2, test_fraction=0.4, validation_fraction=0.4), "scripted")
    assert [plan.split for plan in plans] == ["train", "train"]


def test_no_split_where_none_is_asked_for() -> None:
    plans = plan_episodes(CollectConfig(episodes=10, test_fraction=0, validation_fraction=0), "scripted")
    assert {plan.split for plan in plans} == {"train"}


def test_plan_depends_on_the_seed_and_not_on_workers() -> None:
    base = CollectConfig(episodes=20)
    assert plan_episodes(base, "scripted") == plan_episodes(base.model_copy(update={"workers": 9}), "scripted")
    other = plan_episodes(base.model_copy(update={"seed": 1}), "scripted")
    assert [plan.kept_steps for plan in other] != [plan.kept_steps for plan in plan_episodes(base, "scripted")]


def test_an_injected_policy_takes_the_place_of_the_script() -> None:
    plans = plan_episodes(CollectConfig(episodes=10), "policy")
    assert Counter(plan.behaviour for plan in plans) == {"random": 4, "policy": 6}


def test_streams_of_an_episode_are_independent_and_repeatable() -> None:
    first, second = plan_episodes(CollectConfig(episodes=2), "scripted")
    draws = [plan.rng(stream).random() for plan in (first, second) for stream in Stream]
    assert len(set(draws)) == len(draws)
    assert first.rng(Stream.CAMERA).random() == first.rng(Stream.CAMERA).random()
