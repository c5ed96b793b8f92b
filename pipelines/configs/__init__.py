"""Settings of all stages: a frozen dataclass each, with unit, meaning and origin.

`Sec.` and `Eq.` cite the paper, `D.` a record of docs/decisions.
"""

from pipelines.configs.dataset import (
    AnnotateSymmetryConfig,
    ExportCocoConfig,
    LabelConfig,
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
    InferConfig,
    InspectConfig,
    ViewConfig,
    WatchConfig,
)
from pipelines.configs.learning import (
    AugmentationConfig,
    DetectorConfig,
    EndlessConfig,
    FinetuneDetectorConfig,
    NetworkConfig,
    TrainConfig,
)
from pipelines.configs.planning import LimitsConfig, RegionConfig, SelectionConfig
from pipelines.configs.settings import check_settings, from_settings

__all__ = [
    "AnnotateSymmetryConfig",
    "AugmentationConfig",
    "CompareConfig",
    "ConvertFramesConfig",
    "DetectorConfig",
    "DoctorConfig",
    "EndlessConfig",
    "EvaluateConfig",
    "EvaluateDumpConfig",
    "ExportCocoConfig",
    "ExportConfig",
    "FinetuneDetectorConfig",
    "InferConfig",
    "InspectConfig",
    "LabelConfig",
    "LabelGraspsConfig",
    "LimitsConfig",
    "NetworkConfig",
    "PackConfig",
    "RefineGraspsConfig",
    "RegionConfig",
    "ScoreGraspsConfig",
    "SelectionConfig",
    "SimulateConfig",
    "SynthesizeConfig",
    "TrainConfig",
    "ViewConfig",
    "WatchConfig",
    "check_settings",
    "from_settings",
]
