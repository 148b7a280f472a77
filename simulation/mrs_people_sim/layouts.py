"""Random scenes from a few numbers and a seed."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.errors import ConfigError
from mrs_people_loc.guiding.way import Way
from mrs_people_sim.models import interiors
from mrs_people_sim.models.rooms import SIZES, footprint
from mrs_people_sim.scene import Furniture, Layout, Person, Robot, Room, Scene, StereoHead
from mrs_people_sim.walking.walks import Boxes, way_of

Rng = np.random.Generator

_LARGE = ("table", "desk", "shelf", "cabinet", "pillar", "plant", "partition", "sofa", "board",
          "sign", "coat_stand", "chair", "desk", "chair")  # fmt: skip
_SMALL = ("chair", "bin", "boxes", "lamp", "plant", "boxes", "coat_stand")
_WALLED = {"shelf", "cabinet", "desk", "sofa", *interiors.WALLED}
#: With `variety`: kinds and how often each is chosen.
_VARIED = {
    "door": 6, "workplace": 5, "office_chair": 3, "wardrobe": 3, "doorway": 3, "corner": 3,
    "covered_table": 3, "whiteboard": 3, "chair": 2, "pier": 2, "curtain": 2, "ladder": 2,
    "coat_hooks": 2, "rack": 2, "radiator": 2, "window": 2, "coat_on_stand": 1, "water_cooler": 1,
    "table": 1, "desk": 1, "shelf": 1, "cabinet": 1, "pillar": 1, "plant": 1, "partition": 1,
    "sofa": 1, "board": 1, "sign": 1, "coat_stand": 1,
}  # fmt: skip
_VARIED_SMALL = {
    "office_chair": 5, "chair": 3, "boxes": 2, "coat_on_stand": 1, "ladder": 1, "water_cooler": 1,
    "bin": 1, "lamp": 1, "plant": 1,
}  # fmt: skip
#: Chairs may stand right before a robot.
_CHAIRS = ("chair", "office_chair")


def expand(scene: Scene) -> Scene:
    """The scene with its layout carried out: people, robots and furniture are all named.

    The result depends on the scene and its seed alone.
    """
    expanded = _expanded(scene)
    if not scene.layout.variety:
        return expanded
    rng, named = np.random.default_rng([scene.seed, 101]), len(scene.people)
    people = [*scene.people, *(_varied(person, rng) for person in expanded.people[named:])]
    return dataclasses.replace(expanded, people=tuple(people))


def _expanded(scene: Scene) -> Scene:
    plan = scene.layout
    if not (plan.people or plan.robots or plan.furniture or plan.clutter):
        return scene
    rng = np.random.default_rng([scene.seed, 100])
    if plan.activity == "group":
        return _walking_group(scene, rng)
    if plan.activity == "guided":
        return _waiting_group(scene, rng)
    centre = _centre(scene, rng)
    people = [*scene.people]
    spots = _spots(scene, centre, rng)
    robots, heads = dict(scene.robots), dict(scene.heads)
    common = next(iter(scene.heads.values()), StereoHead())
    names = [f"robot_{chr(ord('a') + k)}" for k in range(26)]
    names = [n for n in names if n not in robots][: plan.robots]
    middle = np.mean(spots, axis=0) if spots else centre
    posts = _posts(scene, middle, spots, len(names), rng)
    tour = plan.activity == "tour"
    for k, (name, (x, y, yaw)) in enumerate(zip(names, posts, strict=True)):
        robots[name] = Robot(
            x=x, y=y, yaw=yaw,
            phase=float(rng.choice([0.0, rng.uniform(0.0, 0.04)])) if k else 0.0,
            body=str(rng.choice(["mast", "column"])),
        )  # fmt: skip
        heads[name] = _head(scene, common, k, rng)
    heads.pop("", None)
    people += _people(scene, middle, spots, rng)
    furniture = [*scene.furniture]
    keep_clear = [*spots, *((r.x, r.y) for r in robots.values())]
    furniture += _furniture(scene, keep_clear, robots, rng)
    result = dataclasses.replace(
        scene,
        people=tuple(people),
        robots=robots,
        heads=heads,
        furniture=tuple(furniture),
    )
    return _guided(result, rng) if tour else result


def _centre(scene: Scene, rng: Rng) -> NDArray:
    """The group's middle: somewhere around the room's."""
    size = np.array([scene.room.length, scene.room.width])
    return size / 2 + rng.uniform(-0.08, 0.08, 2) * size


def _spots(scene: Scene, centre: NDArray, rng: Rng) -> list[tuple[float, float]]:
    """Where the people are (at first), at least 0.5 m apart."""
    plan = scene.layout
    size = np.array([scene.room.length, scene.room.width])
    gap = {"close": 0.50, "talk": 0.6, "tour": 0.65}.get(plan.activity, 0.8)
    spread = 0.35 * gap * math.sqrt(max(plan.people, 1)) + 0.35
    if plan.activity in ("stand", "walk", "mixed"):
        spread = min(1.5, 0.5 + 0.22 * plan.people)
    spots: list[tuple[float, float]] = [(p.x, p.y) for p in scene.people]
    first = len(spots)
    while len(spots) - first < plan.people:
        for attempt in range(400):
            place = centre + rng.normal(0.0, spread * (1 + attempt / 200), 2)
            if plan.activity == "talk" and (len(spots) - first) % 2:
                angle = rng.uniform(0, 2 * math.pi)
                reach = rng.uniform(0.65, 0.95)
                place = np.array(spots[-1]) + reach * np.array([math.cos(angle), math.sin(angle)])
            inside = (place > 0.6).all() and (place < size - 0.6).all()
            least = gap * (1 - attempt / 800)
            if inside and all(math.dist(place, other) >= least for other in spots):
                break
        spots.append((float(place[0]), float(place[1])))
    return spots[first:]


def _posts(
    scene: Scene, centre: NDArray, spots: list[tuple[float, float]], count: int, rng: Rng
) -> list[tuple[float, float, float]]:
    """Where the robots stand: around the group, looking at it, more or less."""
    plan = scene.layout
    size = np.array([scene.room.length, scene.room.width])
    turn = rng.uniform(0, 2 * math.pi)
    posts: list[tuple[float, float, float]] = []
    for k in range(count):
        if plan.variety and spots and rng.random() < 0.65:
            near = _near_post(size, spots, posts, rng)
            if near is not None:
                posts.append(near)
                continue
        for attempt in range(400):
            spread = 2 * math.pi / max(count, 1)
            angle = turn + k * spread + rng.normal(0, 0.25 + attempt / 200)
            reach = rng.uniform(plan.near, plan.far)
            place = centre + reach * np.array([math.cos(angle), math.sin(angle)])
            inside = (place > 0.35).all() and (place < size - 0.35).all()
            apart = all(math.dist(place, spot) > 1.1 for spot in spots)
            clear = all(math.dist(place, post[:2]) > 0.9 for post in posts)
            if inside and apart and clear:
                break
        yaw = math.atan2(*(centre - place)[::-1]) + rng.normal(0, 0.12)
        posts.append((float(place[0]), float(place[1]), float(math.remainder(yaw, 2 * math.pi))))
    return posts


def _near_post(
    size: NDArray,
    spots: list[tuple[float, float]],
    posts: list[tuple[float, float, float]],
    rng: Rng,
) -> tuple[float, float, float] | None:
    """Where a robot looks at one person from 1.2 to 1.8 m, if there is room."""
    for _ in range(60):
        spot = np.array(spots[int(rng.integers(len(spots)))])
        angle, reach = rng.uniform(-math.pi, math.pi), rng.uniform(1.2, 1.8)
        place = spot - reach * np.array([math.cos(angle), math.sin(angle)])
        inside = (place > 0.35).all() and (place < size - 0.35).all()
        apart = all(math.dist(place, other) > 1.1 for other in spots)
        clear = all(math.dist(place, post[:2]) > 0.9 for post in posts)
        if inside and apart and clear:
            yaw = angle + rng.normal(0.0, 0.15)
            return float(place[0]), float(place[1]), float(math.remainder(yaw, 2 * math.pi))
    return None


def _head(scene: Scene, common: StereoHead, k: int, rng: Rng) -> StereoHead:
    kind = scene.layout.heads
    if kind == "varied":
        return _varied_head(scene, common, rng)
    if kind == "trinocular":
        return dataclasses.replace(common, top=common.baseline) if k == 0 else common
    if kind == "tilted" or (kind == "mixed" and rng.random() < 0.6):
        height = float(rng.uniform(1.2, min(2.4, scene.room.height - 0.3)))
        # The higher, the more it looks down: at somebody's chest about 2.6 m away.
        pitch = math.atan2(height - 1.1, rng.uniform(2.0, 3.4))
        return dataclasses.replace(
            common,
            height=round(height, 3),
            pitch=round(min(pitch, 0.5236), 4),
            roll=round(float(rng.uniform(-0.1745, 0.1745)), 4),
            yaw=round(float(rng.normal(0, 0.05)), 4),
            forward=round(float(rng.uniform(0.0, 0.15)), 3),
            left=round(float(rng.uniform(-0.05, 0.1)), 3),
        )
    return common


#: Varied heads: focal length times baseline [px m], focal length at 160 px [px], baseline [m].
_PX_M, _FOCAL, _BASELINE = (5.0, 25.0), (80.0, 400.0), (0.05, 0.25)


def _varied_head(scene: Scene, common: StereoHead, rng: Rng) -> StereoHead:
    """A head of any kind.

    Three in five are about level and 1 m high, as on a robot; one in eight looks up.
    """
    product = math.exp(rng.uniform(*np.log(_PX_M)))
    low = max(_FOCAL[0], product / _BASELINE[1])
    high = min(_FOCAL[1], product / _BASELINE[0])
    focal = math.exp(rng.uniform(math.log(low), math.log(high)))
    mount = rng.random()
    if mount < 0.6:
        height, pitch = float(rng.normal(1.0, 0.12)), float(rng.normal(0.0, 0.03))
        if rng.random() < 0.7:
            # Sees a body 1.5 m away from the knees to the chest.
            focal = float(np.clip(rng.uniform(160.0, 270.0), low, high))
    elif mount < 0.73:
        height, pitch = float(rng.uniform(0.7, 1.0)), float(rng.uniform(-0.26, -0.05))
    else:
        height = float(rng.uniform(1.2, 2.4))
        # At somebody's chest or hips.
        pitch = math.atan2(height - rng.uniform(0.8, 1.2), rng.uniform(1.8, 3.6))
    height = float(np.clip(height, 0.7, min(2.4, scene.room.height - 0.3)))
    focal *= common.width / 160
    return dataclasses.replace(
        common,
        focal=round(focal, 2),
        baseline=round(product * common.width / 160 / focal, 4),
        height=round(height, 3),
        pitch=round(float(np.clip(pitch, -0.26, 0.5236)), 4),
        roll=round(float(np.clip(rng.normal(0.0, 0.04), -0.1745, 0.1745)), 4),
        yaw=round(float(rng.normal(0.0, 0.05)), 4),
        forward=round(float(rng.uniform(0.0, 0.15)), 3),
        left=round(float(rng.uniform(-0.05, 0.1)), 3),
    )


def _varied(person: Person, rng: Rng) -> Person:
    """The person with looks and a posture of their own; one in twelve who stand is bent forward."""
    moves = person.walks or person.member or bool(person.path)
    lean = float(rng.uniform(-0.02, 0.07) if moves else rng.normal(0.0, 0.02))
    if not moves and rng.random() < 0.08:
        lean = float(rng.uniform(0.12, 0.32))

    def pick(options: dict[str, float]) -> str:
        weights = np.array(list(options.values()))
        return str(rng.choice(list(options), p=weights / weights.sum()))

    poses = {"random": 5.0, "crossed": 1.0, "raised": 0.5, "point": 0.5, "hips": 0.5}
    return dataclasses.replace(
        person,
        height=round(float(rng.uniform(1.45, 1.95)), 3),
        build=round(float(np.clip(rng.normal(1.0, 0.13), 0.8, 1.4)), 3),
        lean=round(float(np.clip(lean, -0.05, 0.32)), 3),
        cloth=pick({"random": 6.0, "plain": 2.0, "stripes": 1.0, "blocks": 2.0, "print": 1.0}),
        hair=pick({"random": 7.0, "hat": 1.0, "hood": 1.0, "bun": 1.0}),
        bag=pick({"random": 5.0, "hand": 1.5, "box": 1.0, "coat": 1.0, "backpack": 1.5}),
        pose=person.pose if person.pose != "random" else pick(poses),
    )


def _people(
    scene: Scene, centre: NDArray, spots: list[tuple[float, float]], rng: Rng
) -> list[Person]:
    plan = scene.layout
    people = []
    for k, (x, y) in enumerate(spots):
        seed = int(rng.integers(1, 2**31))
        yaw = float(rng.uniform(-math.pi, math.pi))
        person = Person(x=x, y=y, yaw=yaw, seed=seed)
        if plan.activity == "talk":
            mate = k + 1 if k % 2 == 0 else k - 1
            if mate < len(spots):
                yaw = math.atan2(spots[mate][1] - y, spots[mate][0] - x)
            person = dataclasses.replace(person, yaw=yaw, pose="talk")
        elif plan.activity in ("walk", "mixed"):
            if plan.activity == "walk" or k % 2 == 0:
                # Mostly across the group, so that people stay in view.
                goal: tuple[float, ...] = ()
                if rng.random() < 0.6:
                    away = centre - (x, y)
                    target = centre + away * 0.8 + rng.normal(0, 0.5, 2)
                    size = np.array([scene.room.length, scene.room.width])
                    target = np.clip(target, 0.6, size - 0.6)
                    goal = (float(target[0]), float(target[1]))
                person = dataclasses.replace(
                    person,
                    walks=True,
                    speed=float(rng.uniform(0.6, 1.4)),
                    goal=goal,
                    area=(float(centre[0]), float(centre[1]), 0.6 + 0.8 * plan.near),
                )
            elif rng.random() < 0.4:
                person = dataclasses.replace(person, turn_rate=float(rng.uniform(-0.8, 0.8)))
        people.append(person)
    return people


def _guided(scene: Scene, rng: Rng) -> Scene:
    """A tour: everybody goes along x at one speed, the first robot ahead and looking back."""
    plan = scene.layout
    speed = float(rng.uniform(0.6, 1.1))
    duration = (scene.timing.frames - 1) / scene.timing.rate + 1.2
    way = speed * duration
    count = len(scene.people) - plan.people
    people = list(scene.people[:count])
    for person in scene.people[count:]:
        x0, y0 = person.x - way / 2, person.y
        bend = float(rng.normal(0, 0.1))
        people.append(
            dataclasses.replace(
                person,
                path=(x0, y0, person.x, y0 + bend, x0 + way, y0),
                speed=speed * float(rng.uniform(0.94, 1.06)),
                walks=False,
            )
        )
    xs = [p.x for p in scene.people[count:]] or [scene.room.length / 2]
    middle = float(np.mean([p.y for p in scene.people[count:]] or [scene.room.width / 2]))
    robots = {}
    for k, (name, robot) in enumerate(scene.robots.items()):
        if k == 0:
            x, y, ahead = max(xs) + float(rng.uniform(1.3, 1.9)), middle, True
        else:
            x = min(xs) - float(rng.uniform(1.3, 1.9))
            y, ahead = middle + (0.9, -0.9, 0.0)[(k - 1) % 3], False
            x -= 0.9 * ((k - 1) // 2)
        y = float(np.clip(y + rng.normal(0, 0.1), 0.5, scene.room.width - 0.5))
        robots[name] = dataclasses.replace(
            robot, path=(x - way / 2, y, x + way / 2, y), speed=speed, backwards=ahead
        )
    return dataclasses.replace(scene, people=tuple(people), robots=robots)


# ------------------------------------------------------------------------ walking groups ----

#: Posts of the team: ahead of the group's middle (of the last member, for one who sweeps), to its
#: left, and whether it sweeps. Who is ahead or behind is so much farther away as the group is long.
_FORMATION = (
    (1.7, 0.0, False), (-1.6, 0.35, True), (-1.5, -1.0, False), (1.9, 1.1, False),
    (-1.5, 1.0, False), (2.0, -1.1, False), (-2.6, -0.5, True), (3.0, 0.5, False),
)  # fmt: skip


def _waiting_group(scene: Scene, rng: Rng) -> Scene:
    """A group that waits where the scene's tour begins, and faces where it goes.

    Raises:
        ConfigError: The scene has no tour, or no room there.
    """
    points = scene.tour.get("points")
    if not points:
        raise ConfigError("layout.activity is 'guided'; wanted with it: a tour (section `tour`)")
    (x0, y0), (x1, y1) = points[:2]
    begin, yaw = np.array([x0, y0]), math.atan2(y1 - y0, x1 - x0)
    boxes, people = Boxes(scene), list(scene.people)
    robots = [(robot.x, robot.y) for robot in scene.robots.values()]
    for _ in range(scene.layout.people):
        taken = np.array([(p.x, p.y) for p in people]).reshape(-1, 2)
        for attempt in range(1000):
            angle, away = rng.uniform(-math.pi, math.pi), rng.uniform(0.0, 1.0) ** 0.5
            place = begin + (0.8 + 0.003 * attempt) * away * np.array(
                [math.cos(angle), math.sin(angle)]
            )
            if (
                (np.linalg.norm(taken - place, axis=1) > 0.75).all()
                and all(math.dist(place, robot) > 1.0 for robot in robots)
                and (boxes.clearances(place[None])[0] > 0.4).all()
            ):
                break
        else:
            raise ConfigError(f"no room for {scene.layout.people} people where the tour begins")
        x, y = map(float, place)
        seed = int(rng.integers(1, 2**31))
        people.append(Person(x=x, y=y, yaw=yaw + float(rng.normal(0.0, 0.4)), seed=seed))
    return dataclasses.replace(scene, people=tuple(people))


def _walking_group(scene: Scene, rng: Rng) -> Scene:
    """A group on its way, the team around it, and other people."""
    plan, walk = scene.layout, scene.walk
    way, boxes = way_of(scene), Boxes(scene)
    duration = (scene.timing.frames - 1) / scene.timing.rate
    reach = 0.25 + 0.35 * walk.gap * math.sqrt(max(plan.people, 1))
    start = 2.0 + 2 * reach
    joiners = min(walk.joiners, max(plan.people - 2, 0))
    spots: list[tuple[float, float]] = []
    for _ in range(plan.people - joiners):
        spots.append(_free_spot(way, start, reach, scene, spots, rng))
    people = [Person(x=x, y=y, member=True) for x, y in spots]
    people = _with_events(people, way, start, duration, scene, boxes, rng)
    for _ in range(joiners):
        when = float(rng.uniform(0.25, 0.5)) * duration
        x, y = _roadside(way, start + walk.speed * when + 1.0, scene, boxes, rng)
        middle = way.at(start + walk.speed * when)
        yaw = math.atan2(middle[1] - y, middle[0] - x)
        people.append(Person(x=x, y=y, yaw=yaw, member=True, joins=round(when, 2)))
    for _ in range(walk.strangers):
        people.append(_stranger(way, start, duration, scene, boxes, rng))
    people = [dataclasses.replace(person, seed=int(rng.integers(1, 2**31))) for person in people]
    robots, heads = _formation(way, start, reach, scene, rng)
    everybody = (*scene.people, *people)
    keep_clear = [*((p.x, p.y) for p in everybody), *((r.x, r.y) for r in robots.values())]
    furniture = [*scene.furniture, *_furniture(scene, keep_clear, {}, rng)]
    return dataclasses.replace(
        scene, people=everybody, robots=robots, heads=heads, furniture=tuple(furniture)
    )


def _with_events(
    people: list[Person],
    way: Way,
    start: float,
    duration: float,
    scene: Scene,
    boxes: Boxes,
    rng: Rng,
) -> list[Person]:
    """The members, some of whom fall behind or leave."""
    people, walk = list(people), scene.walk
    order = rng.permutation(len(people))
    events = [*["behind"] * walk.stragglers, *["leaves"] * walk.leavers][: len(people)]
    for k, event in zip(order, events, strict=False):
        if event == "behind":
            first = rng.uniform(0.08, 0.2) if duration < 60 else rng.uniform(0.05, 0.8)
            behind = (round(first * duration, 2), round(float(rng.uniform(3.0, 6.0)), 2))
            people[k] = dataclasses.replace(people[k], behind=behind)
        else:
            when = round(float(rng.uniform(0.25, 0.5)) * duration, 2)
            goal = _way_out(way, start + walk.speed * when, scene, boxes)
            people[k] = dataclasses.replace(
                people[k], leaves=when, goal=goal, speed=round(float(rng.uniform(0.9, 1.3)), 3)
            )
    return people


def _formation(
    way: Way, start: float, reach: float, scene: Scene, rng: Rng
) -> tuple[dict[str, Robot], dict[str, StereoHead]]:
    """The robots around the group, those of the scene included, and their heads."""
    robots, heads = dict(scene.robots), dict(scene.heads)
    common = next(iter(scene.heads.values()), StereoHead())
    names = [f"robot_{chr(ord('a') + k)}" for k in range(26)]
    names = [n for n in names if n not in robots][: scene.layout.robots]
    for k, name in enumerate(names):
        ahead, left, sweeps = _FORMATION[k]
        ahead += float(rng.normal(0, 0.1))
        if not sweeps:
            ahead += math.copysign(reach, ahead)
        left += float(rng.normal(0, 0.1))
        base = start - (reach if sweeps else 0.0)
        x, y = way.at(base + ahead, left)
        middle = way.at(start)
        robots[name] = Robot(
            x=float(x), y=float(y), yaw=math.atan2(middle[1] - y, middle[0] - x),
            post=(round(ahead, 3), round(left, 3)), sweeps=sweeps,
            phase=float(rng.choice([0.0, rng.uniform(0.0, 0.04)])) if k else 0.0,
            body=str(rng.choice(["mast", "column"])),
        )  # fmt: skip
        heads[name] = _head(scene, common, k, rng)
    heads.pop("", None)
    return robots, heads


def _free_spot(
    way: Way, start: float, reach: float, scene: Scene, taken: list[tuple[float, float]], rng: Rng
) -> tuple[float, float]:
    """A place in the group, clear of the others."""
    walk = scene.walk
    for attempt in range(400):
        along = start + reach * rng.uniform(-1, 1) * (1 + attempt / 400)
        left = 0.5 * walk.width * rng.uniform(-1, 1) * (1 + attempt / 800)
        x, y = way.at(along, left)
        least = walk.gap * (1 - attempt / 800)
        if all(math.dist((x, y), other) >= least for other in taken):
            break
    return float(x), float(y)


def _way_out(way: Way, along: float, scene: Scene, boxes: Boxes) -> tuple[float, float]:
    """A door: the nearest place at a wall that can be walked to and is not beside the group."""
    here = way.at(along)
    size = np.array([scene.room.length, scene.room.width])
    doors = [np.array([here[0], 0.5]), np.array([here[0], size[1] - 0.5]),
             np.array([0.5, here[1]]), np.array([size[0] - 0.5, here[1]])]  # fmt: skip
    ahead = way.ahead(along)
    open_ = []
    for door in doors:
        line = here + np.linspace(0, 1, 40)[:, None] * (door - here)
        clear = (boxes.clearances(line)[0] > 0.4).all()
        onward = float((door - here) @ ahead) > 1.0
        if clear and not onward and np.linalg.norm(door - here) > 3.0:
            open_.append(door)
    door = min(open_, key=lambda d: float(np.linalg.norm(d - here)), default=way.at(0.0))
    return float(door[0]), float(door[1])


def _roadside(way: Way, along: float, scene: Scene, boxes: Boxes, rng: Rng) -> tuple[float, float]:
    """Where somebody waits beside the way, their back to what is there."""
    side = float(rng.choice((-1.0, 1.0)))
    for far in np.arange(0.5 * scene.walk.width + 1.6, 0.3, -0.1):
        for left in (side * far, -side * far):
            place = way.at(along, left)
            if boxes.clearances(place[None])[0].min() > 0.4:
                return float(place[0]), float(place[1])
    return float(place[0]), float(place[1])


def _stranger(
    way: Way, start: float, duration: float, scene: Scene, boxes: Boxes, rng: Rng
) -> Person:
    """Somebody who meets the group on the way: comes towards it, or crosses its way."""
    walk = scene.walk
    speed = float(rng.uniform(1.0, 1.4))
    when = float(rng.uniform(0.2, 0.6)) * min(duration, 30.0)
    meet = start + walk.speed * when
    narrow = min(scene.room.length, scene.room.width) < 5.0
    for attempt in range(60):
        if narrow or attempt % 2:
            side = float(rng.uniform(0.3, 0.5)) * walk.width * rng.choice((-1, 1))
            far = min(meet + speed * when, way.length - 0.3)
            first, last = way.at(far, side), way.at(max(meet - 12.0, 0.0), side)
        else:
            angle = float(rng.uniform(0.9, 2.2)) * rng.choice((-1, 1))
            forth = way.ahead(meet)
            c, s = math.cos(angle), math.sin(angle)
            across = np.array([c * forth[0] - s * forth[1], s * forth[0] + c * forth[1]])
            first, last = way.at(meet) - speed * when * across, way.at(meet) + 8.0 * across
            size = np.array([scene.room.length, scene.room.width])
            first, last = np.clip(first, 0.5, size - 0.5), np.clip(last, 0.5, size - 0.5)
        line = first + np.linspace(0, 1, 80)[:, None] * (last - first)
        near = np.linalg.norm(first - way.at(start)) < 3.5
        if not near and (boxes.clearances(line)[0] > 0.35).all():
            break
    yaw = math.atan2(last[1] - first[1], last[0] - first[0])
    return Person(
        x=float(first[0]), y=float(first[1]), yaw=yaw, walks=True, speed=round(speed, 3),
        goal=(float(last[0]), float(last[1])),
    )  # fmt: skip


def _furniture(
    scene: Scene, keep_clear: list[tuple[float, float]], robots: dict[str, Robot], rng: Rng
) -> list[Furniture]:
    """Pieces that stand in nobody's way; the large ones mostly along the walls."""
    plan, room = scene.layout, scene.room
    placed: list[Furniture] = []
    large: tuple[str, ...] = _repeated(_VARIED) if plan.variety else _LARGE
    small: tuple[str, ...] = _repeated(_VARIED_SMALL) if plan.variety else _SMALL
    wishes = [(large, 0.6)] * plan.furniture + [(small, 0.2)] * plan.clutter
    for kinds, at_wall in wishes:
        for _ in range(60):
            kind = str(rng.choice(kinds))
            size = _size(kind, room, rng, varied=plan.variety)
            radius = 0.5 * math.hypot(size[0], size[1])
            if kind in _WALLED or rng.random() < at_wall:
                x, y, yaw = _along_wall(room.length, room.width, size, rng)
            else:
                x = float(rng.uniform(0.3 + radius, max(room.length - 0.3 - radius, 0.31 + radius)))
                y = float(rng.uniform(0.3 + radius, max(room.width - 0.3 - radius, 0.31 + radius)))
                yaw = float(rng.uniform(-math.pi, math.pi))
            piece = Furniture(
                kind=kind, x=x, y=y, z=interiors.HANGING.get(kind, 0.0), yaw=yaw, size=tuple(size)
            )
            if kind in ("door", "doorway") and rng.random() < 0.6:
                piece = dataclasses.replace(piece, open=round(float(rng.uniform(0.1, 1.7)), 3))
            if kind == "doorway" and _beside_people(plan) and keep_clear and rng.random() < 0.5:
                x, y = keep_clear[int(rng.integers(len(keep_clear)))]
                piece = dataclasses.replace(piece, x=x, y=y, open=round(rng.uniform(1.3, 1.7), 3))
            if _fits(piece, radius, keep_clear, placed, scene) and not _blocks(
                piece, radius, robots
            ):
                placed.append(piece)
                break
    return placed


def _repeated(kinds: dict[str, int]) -> tuple[str, ...]:
    return tuple(kind for kind, weight in kinds.items() for _ in range(weight))


#: Kinds of the published suite that differ in height.
_TALL = ("shelf", "plant", "partition", "cabinet", "boxes", "sign", "coat_stand")
#: With `variety`: least and greatest share of the usual edge lengths; of kinds that differ more.
_SHARES = (0.85, 0.7, 0.85), (1.2, 1.3, 1.12)
_WIDE_SHARES = (0.8, 0.35, 0.9), (1.3, 1.5, 1.05)


def _size(kind: str, room: Room, rng: Rng, *, varied: bool) -> list[float]:
    """Edge lengths of a piece [m]."""
    size = np.array(SIZES[kind])
    if varied and kind not in ("door", "doorway"):
        wide = kind in ("curtain", "pier", "window", "corner")
        size *= rng.uniform(*(_WIDE_SHARES if wide else _SHARES))
        size[2] = min(size[2], room.height - interiors.HANGING.get(kind, 0.0) - 0.1)
    elif kind in _TALL:
        size[2] *= rng.uniform(0.75, 1.1)
    if kind == "pillar" or kind in interiors.FULL_HEIGHT:
        size[2] = room.height
    return [round(float(edge), 3) for edge in size]


def _along_wall(
    length: float, width: float, size: list[float], rng: Rng
) -> tuple[float, float, float]:
    depth = size[0] / 2 + 0.03
    wall = int(rng.integers(4))
    if wall < 2:
        x = float(rng.uniform(size[1] / 2 + 0.1, max(length - size[1] / 2 - 0.1, size[1])))
        return (x, depth, math.pi / 2) if wall == 0 else (x, width - depth, -math.pi / 2)
    y = float(rng.uniform(size[1] / 2 + 0.1, max(width - size[1] / 2 - 0.1, size[1])))
    return (depth, y, 0.0) if wall == 2 else (length - depth, y, math.pi)


def _fits(
    piece: Furniture,
    radius: float,
    keep_clear: list[tuple[float, float]],
    placed: list[Furniture],
    scene: Scene,
) -> bool:
    plan = scene.layout
    if plan.activity == "group" and not _beside_the_way(piece, radius, scene):
        return False
    if plan.activity == "tour" and abs(piece.y - scene.room.width / 2) < 1.5 + radius:
        return False
    if _beside_people(plan):
        if _least_distance(piece, keep_clear) < _BESIDE:
            return False
    elif any(math.dist((piece.x, piece.y), spot) < radius + 0.45 for spot in keep_clear):
        return False
    others = [f for f in (*scene.furniture, *placed) if f.kind != "wall"]
    return all(
        math.dist((piece.x, piece.y), footprint(other)[:2]) > radius + footprint(other)[2]
        for other in others
    )


def _beside_people(plan: Layout) -> bool:
    """Whether people may stand right beside furniture, or in a doorway."""
    return plan.variety and plan.activity in ("stand", "talk", "close")


#: How near to a piece somebody may stand [m].
_BESIDE = 0.32


def _least_distance(piece: Furniture, spots: list[tuple[float, float]]) -> float:
    """How near the spots come to what a piece covers of the floor [m]."""
    if not spots:
        return math.inf
    cos, sin = math.cos(piece.yaw), math.sin(piece.yaw)
    local = (np.array(spots) - [piece.x, piece.y]) @ np.array([[cos, -sin], [sin, cos]])
    middle, half = np.split(_covered(piece), 2, axis=1)
    outside = np.maximum(np.abs(local[:, np.newaxis] - middle) - half, 0.0)
    return float(np.linalg.norm(outside, axis=2).min())


def _covered(piece: Furniture) -> NDArray:
    """Rectangles that a piece covers, in its frame: middle and half lengths, shape (n, 4) [m]."""
    dx, dy = piece.size[0] / 2, piece.size[1] / 2
    boxes = [(0.0, 0.0, dx, dy)]
    if piece.kind == "doorway":
        side = max((dy - interiors.OPENING / 2) / 2, 0.0)
        boxes = [(0.0, s * (dy - side), dx, side) for s in (-1, 1)]
        if piece.open < 1.2:
            boxes.append((0.0, 0.0, dx, dy))
    if piece.open >= 1.2:
        # The leaf is on one of both sides.
        boxes += [(0.5, s * interiors.OPENING / 2, 0.4, 0.1) for s in (-1, 1)]
    elif piece.open > 0.0:
        boxes.append((0.45, 0.0, 0.45, interiors.OPENING / 2))
    return np.array(boxes)


def _beside_the_way(piece: Furniture, radius: float, scene: Scene) -> bool:
    """Whether it leaves the group and its team room, and is not in a wall."""
    way, walls = way_of(scene), [f for f in scene.furniture if f.kind == "wall"]
    place = np.array([[piece.x, piece.y]])
    if np.linalg.norm(way.at(way.nearest(place)) - place) < scene.walk.width / 2 + radius + 0.6:
        return False
    boxes = Boxes(dataclasses.replace(scene, furniture=tuple(walls)))
    return bool(boxes.clearances(place)[0][0, 4:].min(initial=math.inf) > radius)


def _blocks(piece: Furniture, radius: float, robots: dict[str, Robot]) -> bool:
    """Whether it stands right before a robot, where it would hide all else."""
    for robot in robots.values():
        dx, dy = piece.x - robot.x, piece.y - robot.y
        ahead = dx * math.cos(robot.yaw) + dy * math.sin(robot.yaw)
        aside = abs(-dx * math.sin(robot.yaw) + dy * math.cos(robot.yaw))
        if 0 < ahead < 1.2 + radius and aside < radius + 0.25 * ahead and piece.kind not in _CHAIRS:
            return True
    return False
