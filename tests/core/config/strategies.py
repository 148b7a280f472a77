"""What Hypothesis tries in the place of a configuration."""

from hypothesis import strategies as st

from mrs_people_loc.config import GuideConfig, PlannerConfig, RobotConfig

PARAMETERS = {
    parameter.name: parameter
    for section in (GuideConfig, RobotConfig, PlannerConfig)
    for parameter in section.parameters()
}

plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
values = plain | st.lists(plain, max_size=3)
names = st.sampled_from([*PARAMETERS, *{name.split(".")[0] for name in PARAMETERS}]) | plain
