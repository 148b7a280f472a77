/** Numbers and times as text. */

const MINUS = "\u2212";

/** Return a number with that many decimals and a proper minus sign. */
export function fixed(value, decimals) {
  if (!Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** Return a duration in seconds as "0.4 s", "12 s", "3 min". */
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  if (seconds < 9.95) return `${fixed(seconds, 1)} s`;
  return seconds < 119.5 ? `${Math.round(seconds)} s` : `${Math.round(seconds / 60)} min`;
}

/** Return seconds since the start of a recording as "1:02.3". */
export function timeInBag(seconds) {
  const tenths = Math.max(0, Math.round(seconds * 10));
  const rest = tenths % 600;
  return `${Math.floor(tenths / 600)}:${rest < 100 ? "0" : ""}${(rest / 10).toFixed(1)}`;
}

/** Return a stamp in words: since the start of a bag, the time of day, or seconds of a simulation. */
export function stamp(t, bag) {
  if (bag) return timeInBag(t - bag.start);
  if (t < 1e8) return `${fixed(t, 1)} s`;
  return new Date(t * 1000).toLocaleTimeString([], { hour12: false });
}

/** Return "1 person", "2 people". */
export const count = (n, one, many) => `${n} ${n === 1 ? one : many}`;
