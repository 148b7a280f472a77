/** Numbers and times as text. */

const MINUS = "\u2212";

/** Return a number with that many decimals and a proper minus sign. */
export function fixed(value, decimals) {
  if (!Number.isFinite(value)) return "–";
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** Return a duration in seconds as "0.4 s", "12 s", "3 min", "5 h", "3 days". */
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  if (seconds < 9.95) return `${fixed(seconds, 1)} s`;
  if (seconds < 119.5) return `${Math.round(seconds)} s`;
  const minutes = seconds / 60;
  if (minutes < 119.5) return `${Math.round(minutes)} min`;
  const hours = minutes / 60;
  return hours < 47.5 ? `${Math.round(hours)} h` : `${Math.round(hours / 24)} days`;
}

/** Return that a straggler is behind, and for how long. */
export function behind({ straggling_s: seconds }) {
  return `behind${seconds === null ? "" : ` ${duration(seconds)}`}`;
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
