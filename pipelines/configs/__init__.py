"""Settings of all stages: one frozen dataclass per stage, with units and origins.

`Sec.` and `Eq.` cite the paper, `D.` a record of docs/decisions.
"""

from pipelines.configs.dataset import (
    AnnotateSymmetryConfig,
    ExportCocoConfig,
    LabelConfig,
    LabelGraspsConfig,
    PackConfig,
    RefineGraspsConfig,
    SceneryConfig,
    Surrounding,
    SynthesizeConfig,
)
from pipelines.configs.evaluation import (
    CompareConfig,
    EvaluateConfig,
    EvaluateDumpConfig,
    IntervalConfig,
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
    AugmentationConfig,
    DetectorConfig,
    EndlessConfig,
    FinetuneDetectorConfig,
    NetworkConfig,
    TrainConfig,
    TrainCriticConfig,
)
from pipelines.configs.peers import TrainBaselineConfig
from pipelines.configs.planning import (
    CandidateConfig,
    FeasibilityConfig,
    LimitsConfig,
    RankingConfig,
    SelectionConfig,
    SensorConfig,
    SymmetryConfig,
)
from pipelines.configs.regions import ColorConfig, RegionConfig
from pipelines.configs.settings import check_settings, from_settings
