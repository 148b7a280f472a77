"""Commands of `mrs` for who tries the system: the demo, simulated bags, scores and figures."""

HEADINGS = {
    "To try and to score": {
        "demo": (
            "mrs_people_sim.commands.demo:command",
            "Replay a recorded team and compare with the truth.",
        ),
        "simulate": (
            "mrs_people_sim.commands.simulate:command",
            "Draw what a team would see, with ground truth.",
        ),
        "evaluate": (
            "mrs_people_sim.commands.evaluate:command",
            "Score bags against their ground truth.",
        ),
        "plot": (
            "mrs_people_sim.commands.plot:command",
            "Draw the paper's figures from a bag, or an animation.",
        ),
    },
}
EXAMPLES = {
    "demo": {
        "": "three robots follow a walking group",
        "bags/paper_formation --out paper.png": "the formation of the paper",
    },
    "simulate": {
        "config/scenes/hall.yaml hall.mcap --frames 20": "20 frames of 8 robots in a hall",
        "config/scenes/walking_group.yaml walk": "publish it: mrs replay walk --clock",
    },
    "evaluate": {
        "bags/walking_group": "by the default method",
        "walk.mcap -c team.yaml --json scores.json": "as this team, the figures also as JSON",
    },
    "plot": {
        "bags/walking_group --out figures": "the paper's figures",
        "walk.mcap -c team.yaml --animation walk.gif": "all of it, from above",
    },
}
