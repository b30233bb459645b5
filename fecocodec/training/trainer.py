"""The trainer: networks, optimiser, averaged weights, and one optimisation step."""

from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from fecocodec.atomic import make_folder
from fecocodec.errors import ModelError
from fecocodec.layers.memory_format import to_channels_last
from fecocodec.receiver.model import Receiver
from fecocodec.sender.distortion import PerceptualDistortion
from fecocodec.sender.extractors.compact import CompactExtractor
from fecocodec.sender.extractors.depthsplat_small.checkpoint import LoadReport
from fecocodec.sender.model import Sender
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.sender.precision import run_in_bfloat16
from fecocodec.training.batch import Batch, Extracted
from fecocodec.training.batch_source import BatchSource
from fecocodec.training.configurations import RunSettings
from fecocodec.training.initialisation import start_as_block_transform
from fecocodec.training.loss import loss_of
from fecocodec.training.model_weights import freeze, load_extractor, load_model_weights
from fecocodec.training.optimisation import SkippedSteps, build_optimiser, clipped_step, copy_of_weights, update_average
from fecocodec.training.processes import gather_states, is_first, process_rank, seeded_generator
from fecocodec.training.run_files import append_lines, load_checkpoint, remove_rows_after, save_checkpoint
from fecocodec.training.same_run import deciding_values, require_same_run
from fecocodec.training.sources import Sources
from fecocodec.training.step_learning import StepLearner
from fecocodec.training.training_pass import (
    Coding,
    bypass_coding,
    code_with_additive_noise,
    code_with_noise,
    extract,
    paper_loss,
    run_stages,
)


class Trainer:
    """Sender and receiver with optimiser, averaged weights and random generator. Checkpoint: `folder/last.pt`."""

    def __init__(self, settings: RunSettings, sources: Sources, sender: Sender | None = None) -> None:
        """sender: replaces the sender of the configuration, for example by one with an external extractor."""
        self.settings, self.sources = settings, sources
        configuration = settings.configuration
        if isinstance(configuration.distortion, PerceptualDistortion):
            configuration.distortion.require_weights()
        torch.manual_seed(settings.seed)  # every process starts from the same weights
        self.receiver = Receiver(configuration.receiver)
        self.sender = sender or Sender(configuration.sender, configuration.receiver)
        if isinstance(self.sender.extractor, CompactExtractor):
            start_as_block_transform(self.sender, self.receiver)
        self.networks = nn.ModuleDict({"receiver": self.receiver, "sender": self.sender})
        to_channels_last(self.networks, settings.device)
        if configuration.precision == "bfloat16":
            run_in_bfloat16(self.networks, settings.device)
        self.begin_average()
        freeze(self.sender, self.receiver, configuration.frozen)
        self.optimiser = build_optimiser(self.networks, configuration.optimiser)
        self.generator = seeded_generator(settings.seed)  # from here on each process has its own noise
        self.step, self.skipped, self.num_bad_scenes, self.seed = 0, SkippedSteps(), 0, settings.seed
        self.extractor = ""  # fingerprint of the frozen extractor of the run that is resumed
        self.batches = BatchSource(sources, settings, self.generator)

    @property
    def checkpoint(self) -> Path:
        """The file that `loop.train` saves and `resume` reads."""
        return self.settings.folder / "last.pt"

    @property
    def log(self) -> Path:
        """The CSV file to which `loop.train` appends rows."""
        return self.settings.folder / "log.csv"

    def start_from(self, model: Path) -> None:
        """Load the weights of a model's folder, except an extractor of another kind; see `load_model_weights`."""
        load_model_weights(self.sender, self.receiver, model)
        self.begin_average()

    def start_extractor_from(self, source: Path) -> LoadReport:
        """Load the extractor, see `load_extractor`. Also refuses another frozen one than the resumed run's."""
        report = load_extractor(self.sender, source)
        if self.extractor not in ("", getattr(self.sender.config, "fingerprint", "")):
            raise ModelError(f"{source}: the run began with another extractor, {self.extractor}; give that one.")
        self.begin_average()
        return report

    def begin_average(self) -> None:
        """Start the averaged weights anew, at the present weights."""
        self.average = copy_of_weights(self.networks)

    def resume(self, path: Path) -> None:
        """Restore a checkpoint exactly.

        Raises InputError if configuration or origin differ, ModelError if networks or number of processes differ.
        """
        saved = load_checkpoint(path)
        require_same_run(saved.get("run", {}), self.settings, path)  # older checkpoints have none
        try:
            generator, noise = (saved[name][process_rank()] for name in ("generators", "global_generators"))
            self.networks.load_state_dict(saved["networks"])
            self.optimiser.load_state_dict(saved["optimiser"])
            for name, value in self.average.items():
                value.copy_(saved["average"][name])  # in place: the averaged weights stay on their device
            self.step, self.skipped = saved["step"], SkippedSteps(saved["num_skipped"])
            self.num_bad_scenes = saved.get("num_bad_scenes", 0)
            self.seed = saved.get("seed", self.seed)  # older checkpoints have none
            self.extractor = saved.get("extractor", "")
        except (KeyError, IndexError, RuntimeError, ValueError) as error:
            raise ModelError(
                f"{path}: not a checkpoint of these networks with so many processes ({type(error).__name__}); "
                "train with as many processes as before, or in another folder."
            ) from error
        self.generator.set_state(generator)
        torch.set_rng_state(noise)
        if self._is_on_cuda and "cuda_generators" in saved:
            torch.cuda.set_rng_state(saved["cuda_generators"][process_rank()], self.settings.device)
        if is_first():
            remove_rows_after(self.log, self.step)

    def save(self, path: Path) -> None:
        """Write everything that `resume` needs. Every process must call this; the first one writes."""
        contents: dict[str, Any] = {
            "networks": self.networks.state_dict(),
            "average": self.average,
            "optimiser": self.optimiser.state_dict(),
            "step": self.step,
            "num_skipped": self.skipped.num,
            "num_bad_scenes": self.num_bad_scenes,
            "seed": self.seed,
            "run": deciding_values(self.settings),
            "extractor": getattr(self.sender.config, "fingerprint", ""),
            "generators": gather_states(self.generator.get_state()),
            "global_generators": gather_states(torch.get_rng_state()),
        }
        if self._is_on_cuda:
            contents["cuda_generators"] = gather_states(torch.cuda.get_rng_state(self.settings.device))
        if is_first():
            make_folder(path.parent)
            save_checkpoint(path, contents)

    @property
    def counts(self) -> dict[str, float]:
        """Columns of the log: steps taken, steps skipped, scenes that could not be used."""
        counts = {"step": self.step, "skipped": self.skipped.num, "bad_scenes": self.num_bad_scenes}
        return {name: float(count) for name, count in counts.items()}

    @property
    def _is_on_cuda(self) -> bool:
        return self.settings.device != "cpu"

    def train_step(self) -> dict[str, float]:
        """Draw a batch, take one step and return the parts of the loss. Non-finite gradients skip the step.

        Raises InputError if the training diverges, see `SkippedSteps`.
        """
        configuration = self.settings.configuration
        batch, extracted = self.draw_batch()
        self._report_skipped(batch)
        self.optimiser.zero_grad(set_to_none=True)
        loss, parts = self._loss(batch, extracted)  # a learner adds to the gradients here
        loss.backward()
        norm = clipped_step(self.optimiser, self.networks, configuration.schedule.learning_rate_at(self.step))
        if self.skipped.is_taken(norm):
            update_average(self.average, self.networks, configuration.optimiser.average_decay, self.step)
        self.step += 1
        return parts | {"loss": float(loss.detach()), "gradient": norm}

    def draw_batch(self) -> tuple[Batch, Extracted | None]:
        """Return the batch of the present step, and its kept features if there are any."""
        is_fused = "extractor" in self.settings.configuration.frozen
        return self.batches.at(self.step, self.seed, partial(extract, self.sender, self.receiver, is_fused))

    def _loss(self, batch: Batch, extracted: Extracted | None) -> tuple[Tensor, dict[str, float]]:
        """Run the stages and return the loss and its parts."""
        configuration, coding, num_stages = self.settings.configuration, self.coding, self.num_stages
        if configuration.is_paper:
            outcomes, _ = run_stages(
                self.sender, self.receiver, batch, coding, num_stages, extracted, 0.0, has_all_targets=True
            )
            return paper_loss(batch, outcomes, configuration.distortion)
        weight = configuration.schedule.disparity_weight_at(self.step)
        learner = self._draw_learner()
        outcomes, matched = run_stages(
            self.sender, self.receiver, batch, coding, num_stages, extracted, weight, learner
        )
        perceptual = configuration.perceptual_weight
        loss, parts = loss_of(batch, outcomes, matched, weight, configuration.distortion, perceptual)
        if learner is None:
            return loss, parts
        analysis = learner.analysis_loss()
        return loss + analysis, parts | {"analysis": float(analysis.detach())}

    def _report_skipped(self, batch: Batch) -> None:
        """Count the scenes that could not be used, and write why, one line each, to `bad_scenes_RANK.txt`."""
        self.num_bad_scenes += len(batch.skipped)
        if batch.skipped:
            make_folder(self.settings.folder)
            append_lines(self.settings.folder / f"bad_scenes_{process_rank()}.txt", batch.skipped)

    def _draw_learner(self) -> StepLearner | None:
        """Return what optimises the latents of this step, None for latents as g_a gives them."""
        configuration, network = self.settings.configuration, self.sender.steps
        share = configuration.optimised_share
        if not share or network is None or float(torch.rand((), generator=self.generator)) >= share:
            return None
        return StepLearner(network, DEFAULT, self.generator, configuration.perceptual_weight)

    @property
    def num_stages(self) -> int:
        """Number of stages of the present step: one in one of `alone_every` steps, because files may have one stage."""
        configuration = self.settings.configuration
        every = configuration.alone_every
        if self.step < configuration.schedule.one_stage_until or (every and self.step % every == every - 1):
            return 1
        return configuration.receiver.num_stages

    @property
    def coding(self) -> Coding:
        """How latents are coded at the present step."""
        configuration = self.settings.configuration
        if self.step < configuration.schedule.bypass_until:
            return bypass_coding
        code = code_with_additive_noise if configuration.is_paper else code_with_noise
        return code(self.receiver, self.sender)
