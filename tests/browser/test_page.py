"""The page of `mrs view` in a real browser, on the real server, with a made-up scene."""

import re
from collections.abc import Callable

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from PIL import Image
from playwright.sync_api import Browser, Page, expect

from browser import synthetic_scene as scene
from browser.chromium import wait_until
from browser.page_server import PageServer
from browser.pictures import REFERENCES, difference, map_picture
from mrs_tools.view.protocol import (
    CancelTour,
    Look,
    Play,
    ReleaseRobots,
    Seek,
    Speed,
    StartTour,
    StopRobots,
    Time,
    starting,
)

Open = Callable[..., Page]
PANELS = ("people", "robots", "tour", "events", "health")
PHONES = ((320, 568), (390, 844))
#: Of 255, in one place of the picture: fonts differ by less, a person too many or too few by more.
PICTURE_TOLERANCE = 14


def bag(
    t: float, *, playing: bool = True, speed: float = 1.0, ready: float = scene.BAG["end"]
) -> Time:
    return Time(type="time", t=t, **scene.BAG, ready=ready, playing=playing, speed=speed)


@pytest.fixture
def recording(make_server: Callable[..., PageServer]) -> PageServer:
    return make_server(scene.hello("bag"), *scene.everything(), bag(112.3))


def open_tab(page: Page, name: str) -> None:
    page.locator(f"#tab-{name}").click()
    expect(page.locator(f"#{name}")).to_be_visible()


def view_of(page: Page) -> dict[str, float]:
    view = page.evaluate("import('./main.js').then(({ map }) => ({ ...map.view }))")
    return {key: view[key] for key in ("x", "y", "scale")}


def place_of(page: Page, x: float, y: float) -> tuple[float, float]:
    """Where a place of the map is in the window."""
    box = page.locator("#map").bounding_box()
    assert box is not None
    column, row = page.evaluate(
        "([x, y]) => import('./main.js').then(({ map }) => map.place(x, y))", [x, y]
    )
    return box["x"] + column, box["y"] + row


# ------------------------------------------------------------------------------ the map


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_map_looks_as_in_the_reference_picture(
    server: PageServer, look_at: Open, scheme: str
) -> None:
    page = look_at(server, color_scheme=scheme)
    reference = np.asarray(Image.open(REFERENCES / f"map_{scheme}.png"))

    assert difference(map_picture(page), reference) < PICTURE_TOLERANCE

    someone_left = scene.state(scene.T0, with_tour=True)
    del someone_left["people"][-1]
    server.show(someone_left)
    expect(page.locator("#tab-people")).to_have_text("People 9")
    assert difference(map_picture(page), reference) > PICTURE_TOLERANCE


def test_nothing_is_drawn_while_nothing_changes(server: PageServer, look_at: Open) -> None:
    page = look_at(server, reduced_motion="no-preference")
    page.evaluate(
        """import('./main.js').then(({ map }) => {
            const draw = map._paint.bind(map);
            window.drawn = 0;
            map._paint = (shown) => { window.drawn += 1; draw(shown); };
        })"""
    )
    server.show(scene.event("Nothing to draw."))
    open_tab(page, "events")
    expect(page.locator("#events li").first).to_contain_text("Nothing to draw.")
    assert page.evaluate("window.drawn") == 0

    server.show(scene.state(scene.T0 + 0.2, with_tour=True))
    wait_until(page, "window.drawn > 1")  # on the way from one state to the next


def test_tap_on_a_person_selects_them_in_the_list(server: PageServer, look_at: Open) -> None:
    page = look_at(server)
    person = scene.people(scene.T0)[8]

    page.mouse.click(*place_of(page, person["x"], person["y"]))

    expect(page.get_by_role("button", name="Person 9")).to_have_attribute("aria-pressed", "true")
    expect(page.locator("tr.details")).to_contain_text("1.91 m")
    expect(page.locator("tr.details")).not_to_contain_text("Last seen at")
    page.mouse.click(*place_of(page, 1, 1))
    expect(page.locator("tr.details")).to_have_count(0)


def test_details_of_who_is_hidden_tell_where_they_were_last_seen(
    server: PageServer, look_at: Open
) -> None:
    page = look_at(server)

    page.get_by_role("button", name="Person 4").click()

    expect(page.locator("tr.details")).to_contain_text("Last seen at2.10, 3.40")


def test_wheel_zooms_where_the_pointer_is(server: PageServer, look_at: Open) -> None:
    page = look_at(server)
    before, place = view_of(page), place_of(page, 14, 2)

    page.mouse.move(*place)
    page.mouse.wheel(0, -400)

    wait_until(page, f"map.view.scale > {1.5 * before['scale']}")
    assert place_of(page, 14, 2) == pytest.approx(place, abs=1)  # places of events are rounded


def test_fitted_signs_are_not_below_the_buttons(server: PageServer, look_at: Open) -> None:
    page = look_at(server, 375, 667)
    tools = page.locator("#tools").bounding_box()
    assert tools is not None
    for x in np.arange(18.0, 27.0, 0.4):  # the last robot goes to the right
        state = scene.state(scene.T0, with_tour=True)
        state["robots"][3]["x"] = x
        server.show(state)
        wait_until(page, f"scene.robot('robot_d').x === {x} && !map._frame")
        column, _ = place_of(page, x, 3.0)
        size = page.evaluate(
            "import('./draw.js').then(async (draw) => "
            "draw.robotSize((await import('./main.js')).map.view.scale))"
        )
        assert column + size <= tools["x"]


def test_map_says_the_same_of_a_straggler_as_the_text(server: PageServer, look_at: Open) -> None:
    page = look_at(server)
    page.evaluate(
        """() => {
            window.said = [];
            const { fillText } = CanvasRenderingContext2D.prototype;
            CanvasRenderingContext2D.prototype.fillText = function (text, ...place) {
                const chip = document.querySelector("#summary li").textContent;
                if (text.includes("behind")) window.said.push([text, chip]);
                fillText.call(this, text, ...place);
            };
        }"""
    )
    for step in range(1, 21):
        server.show(scene.state(scene.T0 + 0.1 * step, with_tour=True))
        page.wait_for_timeout(20)
    expect(page.locator("#summary li").first).to_have_text("6 behind 14 s")
    expect(page.locator("tr.straggler .seen")).to_have_text("behind 14 s")
    wait_until(page, "window.said.at(-1)[0] === '6 behind 14 s'")
    assert [(text, chip) for text, chip in page.evaluate("window.said") if text != chip] == []


# ------------------------------------------------------------------------------ connection


def test_connects_again_when_the_server_is_back(server: PageServer, look_at: Open) -> None:
    page = look_at(server)
    expect(page.locator("#connection")).to_have_text("Live")

    server.end()
    expect(page.locator("#connection")).to_have_text("No connection")
    expect(page.locator("#notice")).to_contain_text("The map shows the last known state.")
    assert "grayscale" in page.evaluate(
        "getComputedStyle(document.querySelector('#canvas')).filter"
    )

    server.listen()
    server.show(scene.event("Back again."))
    expect(page.locator("#connection")).to_have_text("Live", timeout=20_000)
    expect(page.locator("#notice")).to_be_hidden()
    open_tab(page, "events")
    events = page.locator("#events li")
    expect(events).to_have_text([re.compile("Back again"), re.compile("Person 12 is new")])


def test_recording_that_connects_again_is_not_said_to_be_live(
    recording: PageServer, look_at: Open
) -> None:
    page = look_at(recording)
    expect(page.locator("#connection")).to_have_text("Playing")
    recording.end()
    expect(page.locator("#announcer")).to_contain_text("No connection to mrs view.")
    recording.listen()
    expect(page.locator("#announcer")).to_have_text("Connected again.", timeout=20_000)


def test_old_people_are_said_to_be_old(server: PageServer, look_at: Open) -> None:
    page = look_at(server, 375, 667)
    for age, text in (
        (75.0, "75 s"),
        (119 * 60.0, "119 min"),
        (5 * 3600.0, "5 h"),
        (2.6e5, "3 days"),
    ):
        old = scene.state(scene.T0)
        old["age"] = age
        server.show(old)
        expect(page.locator("#connection")).to_have_text(f"No data for {text}")
        assert page.evaluate(_TOO_WIDE) == []
    notice, area = page.locator("#notice").bounding_box(), page.locator("#map").bounding_box()
    assert notice is not None
    assert area is not None
    assert notice["height"] < 0.2 * area["height"]

    server.show(scene.state(scene.T0 + 80))
    expect(page.locator("#connection")).to_have_text("Live")


def test_old_people_are_not_said_to_be_seen_now(server: PageServer, look_at: Open) -> None:
    page = look_at(server)
    seen = page.locator("#people .seen")
    expect(seen.filter(has_text="now")).not_to_have_count(0)
    old = scene.state(scene.T0)
    old["age"] = 75.0
    server.show(old)
    expect(page.locator("#notice")).to_contain_text(re.compile("Last heard 7. s ago"))
    expect(seen.filter(has_text="now")).to_have_count(0)
    expect(seen.filter(has_text=re.compile(r"^7. s ago"))).not_to_have_count(0)

    server.show(scene.state(scene.T0 + 80))
    expect(seen.filter(has_text="now")).not_to_have_count(0)
    server.end()  # nothing comes any more, and the page itself counts on
    expect(seen.filter(has_text="now")).to_have_count(0)
    expect(page.locator("#people .seen").last).to_have_text(re.compile(r"s ago$"))
    open_tab(page, "robots")
    expect(page.locator("#robots .state").first).to_have_text(re.compile("No pose for"))
    server.listen()


def test_a_team_that_starts_has_no_troubles_yet(
    make_server: Callable[..., PageServer], browser: Browser
) -> None:
    server = make_server(scene.hello(), starting("Starting robot_a and the planner."))
    page = browser.new_page()
    page.goto(server.url)
    expect(page.locator("#notice-text")).to_have_text("Starting robot_a and the planner.")
    expect(page.locator("#tab-health")).to_have_text("Health")
    expect(page.locator("#summary li")).to_have_count(0)
    page.close()


# ------------------------------------------------------------------------------ panels


def test_nobody_yet_is_something_else_than_nobody(server: PageServer, look_at: Open) -> None:
    page = look_at(server)
    empty = page.locator("#people .empty")
    for t, text in ((None, "Waiting for people."), (scene.T0, "Nobody is on the map.")):
        state = scene.state(scene.T0)
        state["t"], state["people"], state["groups"] = t, [], []
        server.show(state)
        expect(empty).to_have_text(text)


def test_images_are_asked_for_only_while_their_panel_is_open(
    server: PageServer, look_at: Open
) -> None:
    page = look_at(server)
    open_tab(page, "robots")
    page.get_by_role("button", name="Camera of robot_b").click()
    server.wait_for(lambda: server.looks[-1:] == [Look(frozenset({"robot_b"}))])
    server.show(scene.image("robot_b", scene.T0))
    picture = page.get_by_role("img", name="Camera image of robot_b")
    expect(picture).to_be_visible()
    wait_until(page, "document.querySelector('#robots img[src]').naturalWidth === 120")

    open_tab(page, "people")
    server.wait_for(lambda: server.looks[-1] == Look())
    open_tab(page, "robots")
    server.wait_for(lambda: server.looks[-1] == Look(frozenset({"robot_b"})))
    expect(picture).to_be_hidden()  # until a new one comes
    page.get_by_role("button", name="Camera of robot_b").click()
    server.wait_for(lambda: server.looks[-1] == Look())


def test_cells_are_asked_for_only_while_they_are_shown(server: PageServer, look_at: Open) -> None:
    page = look_at(server)
    button = page.get_by_role("button", name="Show cells")
    button.click()
    server.wait_for(lambda: server.looks[-1:] == [Look(cells=True)])
    before = map_picture(page)
    server.show(scene.cells(scene.T0))
    wait_until(page, "scene.cells")
    assert difference(map_picture(page), before) > 0
    button.click()
    server.wait_for(lambda: server.looks[-1] == Look())


def test_texts_of_others_are_shown_as_text(server: PageServer, look_at: Open) -> None:
    hostile = (
        "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>"
    )
    state = scene.state(scene.T0, with_tour=True)
    state["robots"][3]["name"] = state["robots"][3]["note"] = hostile
    assert state["tour"] is not None
    state["tour"]["name"] = state["tour"]["message"] = hostile
    health = scene.health()
    health["findings"][0]["text"] = health["findings"][0]["advice"] = hostile
    page = look_at(server)
    server.show(state, health, scene.event(hostile))

    for panel, text in zip(
        PANELS[1:], ["#robots .state", "#tour h2", "#events li", "#health .text"], strict=True
    ):
        open_tab(page, panel)
        expect(page.locator(text).filter(has_text=hostile)).to_have_count(1)
        assert page.locator(f"#{panel} img[src='x'], #{panel} script").count() == 0
    assert page.title() == "domain 0 – mrs view"


def test_tour_starts_after_a_question_and_stops_at_once(server: PageServer, look_at: Open) -> None:
    idle = scene.state(scene.T0)
    server.show(idle)
    page = look_at(server)
    open_tab(page, "tour")
    page.get_by_role("button", name="Start…").click()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="Start…").click()
    page.get_by_role("button", name="Start", exact=True).click()
    server.wait_for(lambda: server.commands == [StartTour("museum")])

    server.show(scene.state(scene.T0 + 1, with_tour=True))
    page.get_by_role("button", name="End the tour").click()
    server.wait_for(lambda: server.commands[1:] == [CancelTour()])


def test_robots_are_stopped_at_once_and_released_after_a_question(
    server: PageServer, look_at: Open
) -> None:
    server.show(scene.state(scene.T0, with_tour=True))
    page = look_at(server)
    page.locator("#summary").get_by_role("button", name="Stop the robots").click()
    server.wait_for(lambda: server.commands == [StopRobots()])
    open_tab(page, "tour")
    page.locator("#robots-stop").click()
    server.wait_for(lambda: server.commands == [StopRobots()] * 2)

    stopped = scene.state(scene.T0 + 1, with_tour=True)
    assert stopped["tour"] is not None
    stopped["tour"] |= {"state": "stopped", "message": "stopped by a test"}
    server.show(stopped)
    expect(page.locator("#tour")).to_contain_text("Stopped: stopped by a test")
    expect(page.get_by_role("button", name="Stop the robots")).to_have_count(0)
    page.get_by_role("button", name="Release the robots…").click()
    page.get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="Release the robots…").click()
    page.get_by_role("button", name="Release", exact=True).click()
    server.wait_for(lambda: server.commands[2:] == [ReleaseRobots()])


def test_without_control_a_tour_is_only_shown(
    make_server: Callable[..., PageServer], look_at: Open
) -> None:
    server = make_server(scene.hello(), *scene.everything())
    page = look_at(server)
    open_tab(page, "tour")
    expect(page.locator("#tour")).to_contain_text("Waiting for people: person 6 is behind")
    expect(page.get_by_role("button", name="End the tour")).to_have_count(0)
    page.locator("#robots-stop").click()
    server.wait_for(lambda: server.commands == [StopRobots()])
    expect(page.get_by_role("button", name="Start")).to_have_count(0)


def test_time_line_controls_the_recording(recording: PageServer, look_at: Open) -> None:
    page = look_at(recording)
    slider = page.get_by_role("slider", name="Time in the recording")
    expect(page.locator("#time")).to_have_text("0:12.3 / 1:00.0")

    page.get_by_role("button", name="Pause").click()
    recording.wait_for(lambda: recording.commands == [Play(False)])
    slider.fill("30")
    recording.wait_for(lambda: recording.commands[1:] == [Seek(130.0)])
    recording.show(bag(130.0, playing=False))
    expect(page.locator("#time")).to_have_text("0:30.0 / 1:00.0")
    slider.press("ArrowRight")
    recording.wait_for(lambda: recording.commands[2:] == [Seek(130.1)])
    page.get_by_label("Speed").select_option("2")
    recording.wait_for(lambda: recording.commands[3:] == [Speed(2.0)])
    recording.show(bag(130.1, playing=False, speed=2.0))
    expect(page.locator("#connection")).to_have_text("Paused")
    page.locator("#map").press("k")
    recording.wait_for(lambda: recording.commands[4:] == [Play(True)])


def test_space_plays_and_pauses_but_presses_the_button_that_has_the_focus(
    recording: PageServer, look_at: Open
) -> None:
    page = look_at(recording)
    expect(page.locator("#title")).to_have_text(f"Recording: {scene.hello('bag')['title']}")
    page.locator("#map").press("Space")
    recording.wait_for(lambda: recording.commands == [Play(False)])
    recording.show(bag(113.0, playing=False))
    expect(page.locator("#connection")).to_have_text("Paused")
    page.locator("#seek").press("Space")  # a slider does nothing of its own
    recording.wait_for(lambda: recording.commands[1:] == [Play(True)])

    page.get_by_role("button", name="Person 1", exact=True).press("Space")
    expect(page.locator("tr.details")).to_have_count(1)
    page.locator("#play").press("Space")
    recording.wait_for(lambda: len(recording.commands) == 3)
    assert recording.commands[2:] == [Play(True)]  # once, by the button


def test_after_a_seek_there_are_the_trails_and_events_of_that_time(
    recording: PageServer, look_at: Open
) -> None:
    page = look_at(recording)
    open_tab(page, "events")
    said = page.locator("#events li span")
    early, late = scene.event("person 3 joins", 105.0), scene.event("person 3 leaves", 150.0)
    trail = [[120.0 + step, 0.1 * step, 1.0] for step in range(8)]
    state = scene.state(128.0)
    state["trails"] = {"3": trail}
    recording.show(early, late, bag(151.0))
    expect(said.filter(has_text="person 3 leaves")).to_have_count(1)
    recording.show(state, early, bag(128.0, playing=False))
    expect(said.filter(has_text="person 3 leaves")).to_have_count(0)
    expect(said.filter(has_text="person 3 joins")).to_have_count(1)
    wait_until(page, "scene.trails.get(3)?.length === 8")
    shown = page.evaluate("import('./main.js').then(({ scene }) => scene.trails.get(3))")
    assert shown == trail


# ------------------------------------------------------------------------------ for everybody

_TOO_WIDE = """() => ["html", "[role=tabpanel]:not([hidden])", "dialog[open]"]
    .flatMap((what) => [...document.querySelectorAll(what)])
    .filter((element) => element.scrollWidth > element.clientWidth)
    .map((element) => `${element.id || element.tagName}: ${element.scrollWidth} px`)"""
_TOO_SMALL = """() => [...document.querySelectorAll("button, select, input")]
    .map((element) => element.closest("label") ?? element)
    .map((element) => [element, element.getBoundingClientRect()])
    .filter(([, { width, height }]) => width > 0 && (width < 44 || height < 44))
    .map(([element, { width, height }]) => `${element.outerHTML}: ${width} x ${height}`)"""


@pytest.mark.parametrize(("width", "height"), PHONES)
def test_everything_fits_a_phone_and_a_finger(
    recording: PageServer, look_at: Open, width: int, height: int
) -> None:
    page = look_at(recording, width, height, has_touch=True, is_mobile=True)
    for panel in PANELS:
        open_tab(page, panel)
        assert page.evaluate(_TOO_WIDE) == [], panel
        assert page.evaluate(_TOO_SMALL) == [], panel
    page.get_by_role("button", name="Help and shortcuts").click()
    assert page.evaluate(_TOO_WIDE) == []
    assert page.evaluate(_TOO_SMALL) == []


_REACHABLE = """() => [...document.querySelectorAll("button, select, input, [tabindex]")]
    .filter((element) => element.tabIndex >= 0 && element.checkVisibility()).length"""
_REACHED = """() => {
    const element = document.activeElement;
    const all = [...document.querySelectorAll("*")];
    const { outlineStyle, outlineWidth } = getComputedStyle(element);
    return [all.indexOf(element), outlineStyle !== "none" && parseFloat(outlineWidth) >= 2];
}"""


def test_tab_reaches_everything_visibly(recording: PageServer, look_at: Open) -> None:
    page = look_at(recording)
    reached: dict[int, bool] = {}
    while True:
        page.keyboard.press("Tab")
        element, visible = page.evaluate(_REACHED)
        if element in reached or page.evaluate("document.activeElement === document.body"):
            break
        reached[element] = visible
    assert len(reached) == page.evaluate(_REACHABLE) > 20
    assert all(reached.values())


def test_works_with_the_keyboard_alone(server: PageServer, look_at: Open) -> None:
    page = look_at(server)
    before = view_of(page)
    page.locator("#map").focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("+")
    after = view_of(page)
    assert after["x"] > before["x"]
    assert after["scale"] == pytest.approx(1.25 * before["scale"])

    page.keyboard.press("n")
    expect(page.get_by_role("button", name="Person 1", exact=True)).to_have_attribute(
        "aria-pressed", "true"
    )
    page.keyboard.press("Escape")
    expect(page.locator("tr.details")).to_have_count(0)

    page.locator("#tab-people").focus()
    page.keyboard.press("ArrowRight")
    expect(page.locator("#robots")).to_be_visible()
    page.keyboard.press("End")
    expect(page.locator("#health")).to_be_visible()

    page.keyboard.press("?")
    page.get_by_label("Single-key shortcuts").press("Space")
    page.keyboard.press("Escape")
    expect(page.locator("#help")).to_be_hidden()
    page.keyboard.press("1")
    expect(page.locator("#health")).to_be_visible()  # shortcuts are off


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_violation_of_wcag_aa(server: PageServer, look_at: Open, scheme: str) -> None:
    page = look_at(server, color_scheme=scheme)
    server.show(scene.image("robot_a", scene.T0))
    page.get_by_role("button", name="Person 6").click()
    wanted = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}

    def violations() -> list[str]:
        found = Axe().run(page, options=wanted).response["violations"]
        return [f"{one['id']}: {node['html']}" for one in found for node in one["nodes"]]

    for panel in PANELS:
        open_tab(page, panel)
        assert violations() == [], panel
    server.show(bag(112.3))
    expect(page.locator("#timeline")).to_be_visible()
    page.keyboard.press("?")
    expect(page.locator("#help")).to_be_visible()
    assert violations() == []
    server.end()
    page.keyboard.press("Escape")
    expect(page.locator("#notice")).to_be_visible()
    assert violations() == []
    server.listen()
