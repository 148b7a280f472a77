/** The colours of the map: the custom properties --map-… of view.css, by their names without that. */

/** Groups have so many colours. */
export const GROUPS = 6;
const NAMES = [
  "back", "line", "wall", "block", "unknown", "person", "straggler", "robot", "view", "cell", "post",
  "label", "halo", "select", ...Array.from({ length: GROUPS }, (_, i) => `group-${i}`),
];

/** Return name -> colour, as the light or dark scheme of the moment has them. */
export function mapColours() {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(NAMES.map((name) => [name, style.getPropertyValue(`--map-${name}`).trim()]));
}

/** Return the name of the colour of a group; null: of people without one. */
export const groupColour = (group) => (group === null ? "person" : `group-${group % GROUPS}`);
