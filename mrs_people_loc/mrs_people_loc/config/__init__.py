"""Configuration: frozen, validated, and the one place of every default.

Each field states its meaning, unit and allowed range; ROS parameters, the YAML files in `config/`
and the tables in the documentation derive from these definitions. Lengths are metres, times
seconds, angles radians, unless the name says otherwise (`_px`). The paper's constants are those of
Martinez-Garcia, Ohya & Yuta (2004); `config/paper.yaml` holds them.

| module | |
|---|---|
| `parameters` | one parameter, and sections of them |
| `robot` | sections of `robot_node` |
| `planner` | sections of `planner_node` |
| `guide` | sections of `guide_node` |
| `files` | parameter files, which describe a team |
"""

from mrs_people_loc.config.files import (
    GUIDE_NODE,
    NODE_PARAMETERS,
    PLANNER_NODE,
    ROBOT_NODE,
    Team,
    has_parameters,
    load_team,
    load_yaml,
    overridden,
    robots_named,
)
from mrs_people_loc.config.guide import Base, Formation, GuideConfig, Pace, Safety
from mrs_people_loc.config.parameters import (
    Parameter,
    Section,
    Value,
    suggestion,
)
from mrs_people_loc.config.planner import (
    PEOPLE_TOPICS,
    Clustering,
    Groups,
    Human,
    Interval,
    Joining,
    Masking,
    Outputs,
    PlannerConfig,
    Splitting,
    Tracking,
)
from mrs_people_loc.config.robot import (
    Bodies,
    CollisionMonitoring,
    Disparity,
    Floor,
    Images,
    Localization,
    Mounting,
    Noise,
    PoseInput,
    Quantization,
    RobotConfig,
    Sight,
    WallSensors,
    Zones,
)

__all__ = [
    "GUIDE_NODE",
    "NODE_PARAMETERS",
    "PEOPLE_TOPICS",
    "PLANNER_NODE",
    "ROBOT_NODE",
    "Base",
    "Bodies",
    "Clustering",
    "CollisionMonitoring",
    "Disparity",
    "Floor",
    "Formation",
    "Groups",
    "GuideConfig",
    "Human",
    "Images",
    "Interval",
    "Joining",
    "Localization",
    "Masking",
    "Mounting",
    "Noise",
    "Outputs",
    "Pace",
    "Parameter",
    "PlannerConfig",
    "PoseInput",
    "Quantization",
    "RobotConfig",
    "Safety",
    "Section",
    "Sight",
    "Splitting",
    "Team",
    "Tracking",
    "Value",
    "WallSensors",
    "Zones",
    "has_parameters",
    "load_team",
    "load_yaml",
    "overridden",
    "robots_named",
    "suggestion",
]
