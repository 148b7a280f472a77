"""Public pictures of people and rooms that a network is trained on."""

from __future__ import annotations

from mrs_studies.recordings.sources import Source

ROOMS = Source(
    "SilviuBR24/room-classification",
    "0eca0b20ccf85e0278dcf88f887e320ff4cfa426",
    "Places365, for research and education",
    "30,000 pictures of homes and entrance halls, 256 x 256, without labels of people",
)
WATCHED = Source(
    "madeelworks/Weapon-Detection",
    "1379b38b4028a580c4c7efa9bf816e04868f2eb8",
    "CC BY 4.0",
    "4,408 pictures, most of them of cameras in shops, offices and corridors, with boxes of people",
)
MEETINGS = Source(
    "linagora-labs/panoramic-dataset-for-person-detection",
    "8273dda2ea1391b21445df98164a1a4c0a911d06",
    "none stated",
    "2,004 panoramas of meetings with boxes of people",
)
GESTURES = Source(
    "linto-ai/panoramic-dataset-for-gestures-detection",
    "7774270e0ae6748ffcc0abe635d2afc389966270",
    "none stated",
    "2,085 panoramas of meetings with boxes of people",
)
FASHION = Source(
    "bearpaw/clothing-co-parsing",
    "fe34fb77721a9973fbae92c05f7f12b664d10110",
    "Apache-2.0",
    "1,004 pictures of one person each, outlined",
)
OUTLINES = Source(
    "VikramShenoy97/Human-Segmentation-Dataset",
    "fe4efc56003005a58b7d2449aa563a20e3861e24",
    "none stated",
    "290 pictures of people, outlined, many of them near and cut by the border",
)
PENN_FUDAN = Source(
    "gmguarino/PennFudan",
    "4d34ade817620786f55ef379ac51534d4d6ea218",
    "none stated",
    "170 pictures of streets with 423 people, each outlined",
)
INRIA = Source(
    "sturkmen72/HOG-object-detection",
    "a4cc23176a4e5c9949954caeb2aaeb14132ee08f",
    "none stated",
    "1,208 people, each in the middle of a window of 96 x 160",
)
#: Tells which pictures without labels show people; its weights are used here and not kept.
TEACHER = Source(
    "GreenWaves-Technologies/yolox_people_detection",
    "3f1a88b1ab9d3aff1ef2d0d9c6a4a0c34733e96b",
    "none stated",
    "a detector of people, trained on COCO",
)
