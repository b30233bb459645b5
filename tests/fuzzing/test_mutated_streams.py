"""Streams that were changed in any way decode or are refused, and nothing else."""

from hypothesis import given, settings
from hypothesis import strategies as st

from fecocodec.container import list_sections
from tests.fuzzing.mutations import CHANGES, Mutation, apply, corpus, sealed, section_starts
from tests.fuzzing.verdicts import EVERY_VERDICT, is_whole, verdict

WHOLE = [data for data in corpus() if is_whole(data)]
MUTATIONS = st.lists(
    st.builds(
        Mutation,
        st.sampled_from(sorted(CHANGES)),
        st.floats(0, 1, exclude_max=True),
        st.integers(0, 2**16 - 1),
    ),
    min_size=1,
    max_size=4,
)


@settings(max_examples=400)
@given(st.sampled_from(corpus()), MUTATIONS, st.booleans())
def test_a_mutated_stream_decodes_or_is_refused(data: bytes, mutations: list[Mutation], seals: bool) -> None:
    assert verdict(apply(data, tuple(mutations), seals)) in EVERY_VERDICT


def test_sealing_a_whole_stream_changes_nothing() -> None:
    """Otherwise mutants with checksums that hold would be rarer than they seem."""
    assert len(WHOLE) >= 25
    assert all(sealed(bytearray(data)) == data for data in WHOLE)


def test_a_changed_payload_under_a_right_checksum_is_refused() -> None:
    """ANS shows no errors of its own: what notices is the rule for its end, and the digest."""
    data = next(data for data in WHOLE if [section.name for section in list_sections(data)] == ["cameras", "B1", "B2"])
    begin, end = section_starts(data)[1:3]
    for at in range(begin + 9, end, 11):
        assert verdict(apply(data, (Mutation("flip", at / len(data), at),), seals=True)) == "refused by symbols"
