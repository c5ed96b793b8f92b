"""Settings of every command by its name."""

from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

from pipelines import configs
from pipelines.configs import (
    EvaluateConfig,
    EvaluateDumpConfig,
    InferConfig,
    IntervalConfig,
    ServeConfig,
    WatchConfig,
)
from pipelines.errors import UnknownNameError

Config = TypeVar("Config")


@dataclass(frozen=True)
class InferSettings(InferConfig):
    """Detection of grasps in frames."""

    watch: WatchConfig = field(default_factory=WatchConfig)  # not in the stamp


@dataclass(frozen=True)
class ServeSettings(InferConfig):
    """Grasps over HTTP."""

    http: ServeConfig = field(default_factory=ServeConfig)


@dataclass(frozen=True)
class EvaluateSettings(IntervalConfig, EvaluateConfig):  # no interval is in a record or its stamp
    """Metrics (Sec. IV)."""

    graspnet: EvaluateDumpConfig = field(default_factory=EvaluateDumpConfig)  # another protocol


STAGE_SETTINGS: dict[str, type] = {
    "doctor": configs.DoctorConfig,
    "synthesize": configs.SynthesizeConfig,
    "label-grasps": configs.LabelGraspsConfig,
    "annotate-symmetry": configs.AnnotateSymmetryConfig,
    "refine-grasps": configs.RefineGraspsConfig,
    "pack": configs.PackConfig,
    "export-coco": configs.ExportCocoConfig,
    "finetune-detector": configs.FinetuneDetectorConfig,
    "train": configs.TrainConfig,
    "train-critic": configs.TrainCriticConfig,
    "train-baseline": configs.TrainBaselineConfig,
    "inspect": configs.InspectConfig,
    "convert-frames": configs.ConvertFramesConfig,
    "gripper": configs.GripperConfig,
    "workspace": configs.WorkspaceConfig,
    "infer": InferSettings,
    "serve": ServeSettings,
    "view": configs.ViewConfig,
    "export": configs.ExportConfig,
    "score-grasps": configs.ScoreGraspsConfig,
    "simulate": configs.SimulateConfig,
    "evaluate": EvaluateSettings,
    "compare": configs.CompareConfig,
}


def default_settings(stage: str) -> Any:  # noqa: ANN401 - a config
    """Return the default settings of a stage.

    Raises:
        UnknownNameError: the stage is unknown.
    """
    if stage not in STAGE_SETTINGS:
        raise UnknownNameError("stage", stage, STAGE_SETTINGS)
    return STAGE_SETTINGS[stage]()


def as_config(kind: type[Config], settings: Any) -> Config:  # noqa: ANN401 - a subclass of `kind`
    """Return the part of `settings` that belongs to the config `kind`."""
    names = [each.name for each in fields(kind)]  # type: ignore[arg-type]  # a dataclass
    return kind(**{name: getattr(settings, name) for name in names})
