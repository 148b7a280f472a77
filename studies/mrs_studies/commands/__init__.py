"""Commands of `mrs` that measure and fit, where the repository is."""

HEADINGS = {
    "Studies": {
        "experiment": (
            "mrs_studies.commands.experiment:command",
            "Repeat the paper's experiment, simulated.",
        ),
        "real": (
            "mrs_studies.commands.real:command",
            "Score the labelled recordings of real rooms.",
        ),
        "rooms": (
            "mrs_studies.commands.rooms:command",
            "Count the people who are found in rooms without any.",
        ),
        "localization": (
            "mrs_studies.commands.localization:command",
            "Score a team's poses on simulated tours of 100 m.",
        ),
        "guiding": (
            "mrs_studies.commands.guiding:command",
            "Score guided tours of 60 m, simulated without rendering.",
        ),
        "suite": (
            "mrs_studies.commands.suite:command",
            "Score the published suite, step by step.",
        ),
        "render-suite": (
            "mrs_studies.commands.render_suite:command",
            "Render the published suite, or variants to fit to.",
        ),
        "fit": (
            "mrs_studies.commands.fit:command",
            "Fit the body model to bags with ground truth.",
        ),
        "bench": (
            "mrs_studies.commands.bench:command",
            "Measure speed, after comparing with plain loops.",
        ),
        "convert": ("mrs_studies.commands.convert:app", "Write foreign recordings as bags."),
    },
}
EXAMPLES = {
    "experiment": {"--draws 5 --json figures.json": "five recordings of each scene"},
    "real": {".recordings --out docs/real_rooms.md": "score them all into this file"},
    "rooms": {".pictures --only fitting": "the half that may be fitted to"},
    "localization": {"--seeds 3 --only hall": "three tours of each kind in the hall"},
    "guiding": {"--seeds 3 --only corridor": "three tours of each kind in the corridor"},
    "suite": {".suite/test --steps": "render it there if need be, and score each step"},
    "render-suite": {
        "test bags --walks": "the walking groups of the test half",
        "train .suite/more --variants 12": "12 variants of each scene",
    },
    "fit": {
        ".suite/train/* --out model.json --jobs 2": "a model from the suite's train half",
    },
    "bench": {
        "": "everything, also real processes over DDS",
        "--no-live --frames 100": "the computation only, sooner",
    },
    "convert oak": {"overhead overhead.mcap --frames 0:600:3": "every third of 600 frames"},
    "convert pcl": {"five_people.pcd five.mcap": "PCL's frame of five people"},
    "convert mrclam": {"MRCLAM_Dataset6 mrclam6.mcap": "five robots with real wheels"},
}
