"""What only the network sees is told apart from what was measured, is never exact, and only where nothing measured is.

How sure the network is comes from coefficients that are learned anew with every network: the tests that need an answer
put ones in their place that believe every guess, or none.
"""

from collections import Counter

import numpy as np
import pytest

from model import Detection, Detector
from model.geometry.frames import UnitFrame
from model.geometry.transforms import reflect
from model.meshes.mesh import Mesh
from model.network.proposals import Proposals
from model.paper.validation import MAX_ERROR
from model.search import answer, confidence, prediction
from model.search.full import Sources
from tests.shapes import as_mesh, known, moved, pose
from training.evaluation.corruptions import add_noise
from training.inputs.depth import visible_part
from training.shapes.solids import random_rotation

DEGREES = 5.0


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector.load()


def scan(seed: int = 4) -> tuple[Mesh, np.ndarray]:
    """A chair as one depth image sees it, and the normal of the plane it had."""
    rotation, move, scale = pose(seed)
    shape = known("chair", 2)
    chair = moved(as_mesh(shape), rotation, move, scale)
    seen = visible_part(chair.vertices, chair.faces, random_rotation(np.random.default_rng(seed))[:1])
    return Mesh.checked(*seen), rotation @ shape.planes[0, :3]


def angle(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.degrees(np.arccos(min(1.0, abs(float(first @ second))))))


def believing(monkeypatch: pytest.MonkeyPatch, *, measured: bool, predicted: bool) -> None:
    """Believe no measured level (but what holds everywhere) or each, and the first guess of the network or none."""

    def learned(kind: str, names: tuple[str, ...]) -> confidence.Learned:
        wanted, size = (predicted, len(names) + 1)
        if kind == "measured":
            wanted, size = measured, confidence.terms(np.zeros((1, len(names)))).shape[1]
        coefficients = np.zeros(size)
        coefficients[0] = 2.0 if wanted else -5.0
        return confidence.Learned(coefficients, np.zeros(len(names)))

    monkeypatch.setattr(confidence, "learned", learned)
    monkeypatch.setattr(prediction, "learned", learned)


def evidence_of(detection: Detection) -> set[str]:
    chosen = [level for level in detection.levels if level.chosen]
    return {item.evidence for item in (*detection.planes, *detection.axes, *chosen)}


def test_a_plane_that_only_the_network_sees_is_the_answer_and_says_so(
    detector: Detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh, normal = scan()
    believing(monkeypatch, measured=False, predicted=True)
    detection = detector.detect(mesh)
    assert detection.point_group == "Cs"
    assert (len(detection.planes), len(detection.axes)) == (1, 0)
    plane = detection.planes[0]
    assert evidence_of(detection) == {"predicted"}
    assert not plane.exact
    assert plane.confidence == pytest.approx(1.0 / (1.0 + np.exp(-2.0)), abs=0.01)
    assert plane.symmetry_error <= MAX_ERROR
    assert angle(plane.normal, normal) < DEGREES
    (chosen,) = [level for level in detection.levels if level.chosen]
    assert chosen is detection.levels[-1]
    assert (chosen.exact, chosen.next_rms_distance, chosen.breaks) == (False, None, [])
    assert all(level.evidence == "measured" for level in detection.levels[:-1])
    (said,) = [warning for warning in detection.warnings if "predicted, not measured" in warning]
    assert f"{plane.confidence:.2f}" in said


def test_what_is_measured_comes_first(detector: Detector, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, normal = scan()
    believing(monkeypatch, measured=True, predicted=True)
    detection = detector.detect(mesh)
    assert evidence_of(detection) == {"measured"}
    assert min(angle(plane.normal, normal) for plane in detection.planes) < DEGREES
    assert not any("predicted" in warning for warning in detection.warnings)


def test_a_guess_that_the_surface_bears_out_is_measured(detector: Detector, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, normal = scan()
    believing(monkeypatch, measured=False, predicted=True)
    asked: list[bool] = []

    def guesses(*arguments: object) -> list[prediction.Guess]:
        asked.append(True)
        return prediction.guesses(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(answer, "guesses", guesses)
    monkeypatch.setattr(answer, "confidence", lambda *arguments: 0.9 if asked else 0.1)
    detection = detector.detect(mesh)
    assert asked == [True]
    assert evidence_of(detection) == {"measured"}
    assert angle(detection.planes[0].normal, normal) < DEGREES
    needed = [level.rms_distance for level in detection.levels]
    assert needed == sorted(needed)
    assert not any("predicted" in warning for warning in detection.warnings)


@pytest.mark.parametrize("asked", [{"level": "exact"}, {"tolerance": 0.0}, {"sources": Sources(network=False)}])
def test_only_auto_with_the_network_predicts(
    detector: Detector, monkeypatch: pytest.MonkeyPatch, asked: dict[str, object]
) -> None:
    mesh, _ = scan()
    believing(monkeypatch, measured=False, predicted=True)
    detection = detector.detect(mesh, **asked)  # type: ignore[arg-type]
    assert not detection.planes
    assert all(level.evidence == "measured" for level in detection.levels)


def test_nothing_is_predicted_where_the_network_is_not_sure(
    detector: Detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh, _ = scan()
    believing(monkeypatch, measured=False, predicted=False)
    assert not detector.detect(mesh).planes


def test_nothing_is_predicted_of_a_closed_surface(detector: Detector, monkeypatch: pytest.MonkeyPatch) -> None:
    believing(monkeypatch, measured=False, predicted=True)
    chair = moved(as_mesh(known("chair", 2)), *pose(1))
    noisy = Mesh.checked(*add_noise(chair.vertices, chair.faces, np.random.default_rng(1)))
    detection = detector.detect(noisy)
    assert detection.levels  # it holds roughly, and nothing may be believed here
    assert not detection.planes


def test_guesses_are_planes_apart_that_the_surface_allows(detector: Detector) -> None:
    several = 0
    for seed in range(4):
        mesh, _ = scan(seed)
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        context, network, _ = detector.search(frame.to_unit(mesh.vertices), mesh.faces)
        assert network is not None
        found = prediction.guesses(context, network)
        several += len(found) > 1
        share = len(network.first.planes) / len(network.every.planes)
        votes = np.array([guess.votes for guess in found]) / share
        np.testing.assert_allclose(votes, np.round(votes), atol=1e-9)
        assert 0.0 < votes.sum() <= len(network.every.planes)
        for guess in found:
            assert guess.level.rms <= context.limit
            (plane,) = guess.level.planes
            points = np.random.default_rng(seed).normal(size=(5, 3))
            images = guess.level.generators.apply(points).reshape(-1, 3)
            np.testing.assert_allclose(images, reflect(points, plane), atol=1e-12)
    assert several


def test_the_network_is_asked_once_and_only_for_what_is_needed(
    detector: Detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: Counter[tuple[int | None, int]] = Counter()
    from model.network import output

    original = output.predict_each

    def counting(checkpoint: object, voxels: object, rotation: object, frames: slice) -> Proposals:
        asked[frames.start, frames.stop] += 1
        return original(checkpoint, voxels, rotation, frames)  # type: ignore[arg-type]

    monkeypatch.setattr(output, "predict_each", counting)
    detector.detect(scan()[0])
    # The main view in its frame, then in a second one, and two further views in two frames each.
    assert asked == {(None, 1): 1, (1, 2): 1, (None, 2): 2}


def test_a_guess_is_surer_where_the_surface_bears_it_out_and_nothing_makes_it_certain() -> None:
    rows = np.zeros((3, len(confidence.NAMES) + 2))
    rows[:, confidence.NAMES.index("uncovered")] = [0.0, 0.5, 1e6]
    measured = np.zeros(confidence.terms(rows[:, :-2]).shape[1])
    measured[1 + confidence.NAMES.index("uncovered")] = -3.0
    told = prediction.predict(np.array([0.5, 1.0, 0.2, -0.4]), prediction.weighed(rows, measured))
    assert 1.0 > told[0] > told[1] > told[2] > 0.0
    assert answer.likeliest([]) is None


def test_an_exact_answer_on_a_closed_surface_does_not_wait_for_the_network(
    detector: Detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    from model.network import output

    def unasked(*arguments: object) -> Proposals:
        raise AssertionError("the network was asked")

    chair = moved(as_mesh(known("chair", 2)), *pose(1))
    before = detector.detect(chair)
    monkeypatch.setattr(output, "predict_each", unasked)
    detection = detector.detect(chair)
    assert detection.planes[0].exact
    assert detection.timings_ms["infer"] == 0.0
    np.testing.assert_array_equal(detection.planes[0].normal, before.planes[0].normal)
    with pytest.raises(AssertionError, match="was asked"):
        detector.detect(chair, sources=Sources(inertia=False))
