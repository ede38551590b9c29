import numpy as np
import onnx
import onnxruntime
import pytest

from learned.motion_discriminator import MotionDiscriminator
from learned.onnx_export import export
from learned.predictor import LearnedModel
from learned.window import frames_of, pad, windows


@pytest.mark.parametrize("method", ["mlp", "rdl", "rdl-md", "hrdl", "hrdl-md", "lstm"])
def test_onnx_predicts_what_the_model_predicts(method, tmp_path, stop_and_go, random_model):
    log = stop_and_go(1, seconds=4.0)
    trained = random_model(method)
    path = tmp_path / "model.onnx"
    export(trained, path)
    frames = frames_of(log, trained.rate, trained.cutoff)
    memory = trained.architecture.memory
    padded, place = pad(frames.channels, frames.segments, frames.finite, memory)
    given = {"frames": windows(padded.astype(np.float32), memory)[place - memory + 1]}
    if trained.discriminator.count:
        held = MotionDiscriminator(trained.discriminator, 2).run(frames.motion.q, frames.motion.dq, frames.segments)
        given["held"] = held.reshape(len(held), -1).astype(np.float32)
    (current,) = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"]).run(None, given)
    expected = LearnedModel(trained).predict(log)
    assert np.abs(current - expected).max() < 2e-5 * np.abs(expected).max()
    notes = {p.key: p.value for p in onnx.load(str(path)).metadata_props}
    assert notes == {"unit": "%Use", "rate": "100", "joints": "joint_1 joint_2"}
