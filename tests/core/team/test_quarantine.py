"""Which robots' scans are left out, by what robots tell about themselves and each other."""

from __future__ import annotations

from collections.abc import Mapping

from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.team.quarantine import BACK_NS, HEARD_NS, Quarantine

MS = 1_000_000
A, B, C, D = ROBOTS = ("robot_a", "robot_b", "robot_c", "robot_d")
Words = Mapping[str, tuple[bool, tuple[str, ...]]]

words = st.dictionaries(
    st.sampled_from(ROBOTS),
    st.tuples(st.booleans(), st.sets(st.sampled_from(ROBOTS)).map(sorted).map(tuple)),
)


def told(words: Words, at_ns: int = 0, quarantine: Quarantine | None = None) -> Quarantine:
    """A quarantine that hears every robot say whether it is lost, and whom it doubts."""
    quarantine = quarantine or Quarantine()
    for robot, (lost, doubted) in words.items():
        quarantine.hear(robot, lost, doubted, at_ns)
    return quarantine


def doubting(**doubted: str) -> Words:
    """What robots of short names say, nobody of whom is lost: `a="bc"`."""
    return {f"robot_{a}": (False, tuple(f"robot_{b}" for b in bs)) for a, bs in doubted.items()}


def settled(words: Words) -> dict[str, str]:
    """Who is in quarantine when robots say the same for as long as it takes to come back."""
    quarantine = told(words)
    told(words, BACK_NS, quarantine)
    return quarantine.at(BACK_NS)


def test_nobody_is_in_quarantine_at_first():
    assert Quarantine().at(0) == {}


def test_lost_robot_is_in_quarantine_also_alone_and_when_it_falls_silent():
    quarantine = told({A: (True, ())})
    for at_ns in (0, HEARD_NS, 1000 * HEARD_NS):
        assert quarantine.at(at_ns) == {A: "it says that it is lost"}


def test_robot_comes_back_when_it_was_placed_for_a_while():
    quarantine = told({A: (True, ()), B: (False, ())})
    quarantine.hear(A, False, (), 3000 * MS)
    assert list(quarantine.at(3000 * MS + BACK_NS - 1)) == [A]
    quarantine.hear(A, True, (), 3000 * MS + BACK_NS - 1)
    quarantine.hear(A, False, (), 4000 * MS)
    assert list(quarantine.at(4000 * MS + BACK_NS - 1)) == [A]
    assert quarantine.at(4000 * MS + BACK_NS) == {}


def test_each_way_in_and_out_is_told_once():
    quarantine = told({A: (True, ())})
    quarantine.at(10 * MS)
    assert quarantine.events() == ["robot_a is left out: it says that it is lost"]
    assert quarantine.events() == []
    quarantine.hear(A, False, (), 20 * MS)
    quarantine.at(20 * MS + BACK_NS)
    quarantine.at(30 * MS + BACK_NS)
    assert quarantine.events() == ["robot_a is no longer left out"]


def test_robot_that_two_of_three_doubt_is_left_out():
    assert settled(doubting(a="c", b="c", c="ab")) == {C: "robot_a, robot_b doubt its pose"}


def test_of_two_robots_none_is_left_out_but_the_doubts_are_known():
    quarantine = told(doubting(a="b", b="a"))
    assert quarantine.at(0) == {}
    assert quarantine.doubts(0) == {A: (B,), B: (A,)}


def test_one_doubt_of_three_or_half_of_the_others_is_not_enough():
    assert settled(doubting(a="c", b="", c="")) == {}
    assert settled(doubting(a="c", b="c", c="", d="", e="")) == {}
    assert list(settled(doubting(a="c", b="c", c="", d="c", e=""))) == [C]


def test_halves_that_doubt_each_other_leave_each_other_in():
    assert settled(doubting(a="cd", b="cd", c="ab", d="ab")) == {}
    assert settled(doubting(a="bc", b="ac", c="ab")) == {}


def test_robot_that_is_lost_or_silent_has_no_vote():
    assert list(settled({**doubting(a="c", b="", c=""), B: (True, (C,))})) == [B]
    quarantine = told(doubting(a="c", b="c", c=""))
    assert list(quarantine.at(HEARD_NS)) == [C]
    assert list(quarantine.at(HEARD_NS + 1)) == [C]
    assert quarantine.at(HEARD_NS + BACK_NS) == {}
    assert quarantine.doubts(HEARD_NS + 1) == {}


def test_silent_robots_are_not_counted_among_the_others():
    quarantine = told(doubting(a="", b="", c="", d="", e=""))
    told(doubting(a="c", b="c", c=""), HEARD_NS + 1, quarantine)
    assert list(quarantine.at(HEARD_NS + 1)) == [C]


def test_robot_that_sees_people_where_others_see_nobody_is_left_out_while_that_is_known():
    quarantine = Quarantine()
    quarantine.compare({A: True, B: False}, 0)
    assert quarantine.at(HEARD_NS) == {B: "others see nobody where it sees people"}
    assert quarantine.at(HEARD_NS + BACK_NS) == {}
    quarantine.compare({A: True, B: False}, 2 * HEARD_NS)
    quarantine.compare({A: True}, 2 * HEARD_NS + 1)
    assert quarantine.at(2 * HEARD_NS + BACK_NS) == {}


def test_doubts_do_not_count_against_what_others_see_and_loss_does():
    quarantine = told(doubting(a="c", b="c", c=""))
    quarantine.compare({A: True, C: True}, BACK_NS)
    assert quarantine.at(BACK_NS) == {}
    quarantine.hear(C, True, (), BACK_NS)
    assert list(quarantine.at(BACK_NS)) == [C]


def test_robot_that_nobody_has_heard_may_be_doubted():
    assert list(settled(doubting(a="d", b="d"))) == [D]


@given(words)
def test_who_says_that_it_is_lost_is_in_and_doubts_alone_never_take_everybody(words):
    held = settled(words)
    lost = {robot for robot, (is_lost, _) in words.items() if is_lost}
    assert lost <= set(held)
    voters = set(words) - lost
    assert not voters or voters - set(held)
    for robot in set(held) - lost:
        votes = {name for name in voters - {robot} if robot in words[name][1]}
        assert len(votes) >= 2
        assert len(votes) > len(voters - {robot}) / 2


@given(words)
def test_order_of_the_words_and_names_do_not_matter(words):
    held = settled(words)
    assert settled(dict(reversed(words.items()))) == held
    other = dict(zip(ROBOTS, reversed(ROBOTS), strict=True))
    renamed = {
        other[robot]: (lost, tuple(other[name] for name in doubted))
        for robot, (lost, doubted) in words.items()
    }
    assert {other[robot] for robot in settled(renamed)} == set(held)


@given(words, st.integers(0, 3 * HEARD_NS))
def test_robots_that_are_in_order_again_come_back(words, later_ns):
    quarantine = told(words)
    told(dict.fromkeys(words, (False, ())), later_ns, quarantine)
    assert quarantine.at(later_ns + BACK_NS) == {}


@given(st.lists(words, max_size=6))
def test_events_and_states_agree(rounds):
    quarantine, held = Quarantine(), set()
    for k, said in enumerate(rounds):
        told(said, 300 * MS * k, quarantine)
        now = set(quarantine.at(300 * MS * k))
        for event in quarantine.events():
            robot, _, what = event.partition(" is ")
            held ^= {robot}
            assert (robot in held) == what.startswith("left out: ")
        assert held == now


def test_reset_forgets_everything():
    quarantine = told({A: (True, (B,)), C: (False, (B,)), D: (False, (B,))})
    quarantine.reset()
    assert (quarantine.at(0), quarantine.doubts(0), quarantine.events()) == ({}, {}, [])
