"""Settings of every command by its name."""

from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from pipelines.configs.dataset import (
    AnnotateSymmetryConfig,
    ExportCocoConfig,
    LabelGraspsConfig,
    PackConfig,
    RefineGraspsConfig,
    SynthesizeConfig,
)
from pipelines.configs.evaluation import (
    CompareConfig,
    EvaluateConfig,
    EvaluateDumpConfig,
    ScoreGraspsConfig,
    SimulateConfig,
)
from pipelines.configs.inference import (
    ConvertFramesConfig,
    DoctorConfig,
    ExportConfig,
    GripperConfig,
    InferConfig,
    InspectConfig,
    ServeConfig,
    ViewConfig,
    WatchConfig,
    WorkspaceConfig,
)
from pipelines.configs.learning import (
    FinetuneDetectorConfig,
    TrainConfig,
    TrainCriticConfig,
)
from pipelines.configs.peers import TrainBaselineConfig
from pipelines.errors import UnknownNameError

Config = TypeVar("Config")


@dataclass(frozen=True)
class InferSettings(InferConfig):
    """Frames in, grasps out."""

    watch: WatchConfig = field(default_factory=WatchConfig)  # no part of a stamp


@dataclass(frozen=True)
class ServeSettings(InferConfig):
    """Grasps over HTTP."""

    http: ServeConfig = field(default_factory=ServeConfig)


@dataclass(frozen=True)
class EvaluateSettings(EvaluateConfig):
    """Metrics (Sec. IV)."""

    graspnet: EvaluateDumpConfig = field(default_factory=EvaluateDumpConfig)  # another protocol


STAGE_SETTINGS: dict[str, type] = {
    "doctor": DoctorConfig,
    "synthesize": SynthesizeConfig,
    "label-grasps": LabelGraspsConfig,
    "annotate-symmetry": AnnotateSymmetryConfig,
    "refine-grasps": RefineGraspsConfig,
    "pack": PackConfig,
    "export-coco": ExportCocoConfig,
    "finetune-detector": FinetuneDetectorConfig,
    "train": TrainConfig,
    "train-critic": TrainCriticConfig,
    "train-baseline": TrainBaselineConfig,
    "inspect": InspectConfig,
    "convert-frames": ConvertFramesConfig,
    "gripper": GripperConfig,
    "workspace": WorkspaceConfig,
    "infer": InferSettings,
    "serve": ServeSettings,
    "view": ViewConfig,
    "export": ExportConfig,
    "score-grasps": ScoreGraspsConfig,
    "simulate": SimulateConfig,
    "evaluate": EvaluateSettings,
    "compare": CompareConfig,
}


def default_settings(stage: str) -> Any:  # noqa: ANN401 - a config
    """Return the settings of a stage as they are if nobody changes them.

    Raises:
        UnknownNameError: there is no such stage.
    """
    if stage not in STAGE_SETTINGS:
        raise UnknownNameError("stage", stage, STAGE_SETTINGS)
    return STAGE_SETTINGS[stage]()


def part(kind: type[Config], settings: Any) -> Config:  # noqa: ANN401 - a subclass of `kind`
    """Return of `settings` what the config `kind` holds."""
    names = [each.name for each in fields(kind)]  # type: ignore[arg-type]  # a dataclass
    return kind(**{name: getattr(settings, name) for name in names})
