/** The events of a coder, and the changes of a key or a button. Pure. A change has all fields. */

/**
 * @typedef {{code: string, name: string, kind: "point" | "interval", key: string,
 *   description: string, group: string, modifiers: {name: string, values: string[]}[]}} Code
 */
/**
 * @typedef {{event: string, version: number, code: string, begin: number, end: number | null,
 *   modifiers: Record<string, string>, comment: string}} CodedEvent
 */
/**
 * @typedef {{id: string, event: string, base: number, code: string, begin: number,
 *   end: number | null, modifiers: Record<string, string>, comment: string,
 *   is_deleted: boolean}} Edit
 */

/** To the millisecond, as the server stores it. @param {number} t s */
export const rounded = (t) => Math.round(t * 1000) / 1000;

/**
 * The events as they are with changes that are not saved yet.
 * @param {CodedEvent[]} saved @param {Edit[]} edits @returns {CodedEvent[]} in order of time
 */
export const withEdits = (saved, edits) => {
  const events = new Map();
  for (const { event, version, code, begin, end, modifiers, comment } of saved) {
    events.set(event, { event, version, code, begin, end, modifiers, comment });
  }
  for (const { event, base, code, begin, end, modifiers, comment, is_deleted } of edits) {
    if (is_deleted) {
      events.delete(event);
    } else {
      const version = Math.max(base, events.get(event)?.version ?? 0) + 1;
      events.set(event, { event, version, code, begin, end, modifiers, comment });
    }
  }
  return [...events.values()].sort(
    (one, other) => one.begin - other.begin || one.code.localeCompare(other.code),
  );
};

/**
 * A change of an event.
 * @param {CodedEvent} event @param {Partial<Edit>} changes @param {() => string} newId
 * @returns {Edit}
 */
export const edited = ({ version, ...fields }, changes, newId) => ({
  ...fields,
  id: newId(),
  base: version,
  is_deleted: false,
  ...changes,
});

/** The state event without an end. @param {CodedEvent[]} events @param {string} code */
export const openOne = (events, code) =>
  events.find((event) => event.code === code && event.end === null);

/**
 * The effect of the key of a code: it sets a point; starts a state, which ends the others of its
 * group; or ends the state that is on.
 * @param {CodedEvent[]} events @param {Code[]} codes @param {Code} code @param {number} at s
 * @param {() => string} newId @returns {{edits: Edit[], problem: "" | "too_early"}}
 */
export const press = (events, codes, code, at, newId) => {
  const t = rounded(at);
  if (code.kind === "point") {
    return { edits: [created(code, t, newId)], problem: "" };
  }
  const open = openOne(events, code.code);
  if (open) {
    return t > open.begin
      ? { edits: [edited(open, { end: t }, newId)], problem: "" }
      : { edits: [], problem: "too_early" };
  }
  const group = new Set(
    codes.filter((one) => code.group && one.group === code.group).map((one) => one.code),
  );
  const others = codes
    .filter((one) => one.kind === "interval" && group.has(one.code))
    .flatMap((one) => openOne(events, one.code) ?? []);
  if (others.some(({ begin }) => begin >= t)) {
    return { edits: [], problem: "too_early" };
  }
  return {
    edits: [...others.map((one) => edited(one, { end: t }, newId)), created(code, t, newId)],
    problem: "",
  };
};

const EMPTY = { version: 0, end: null, modifiers: {}, comment: "" };

/** @param {Code} code @param {number} begin @param {() => string} newId @returns {Edit} */
const created = (code, begin, newId) =>
  edited({ ...EMPTY, event: newId(), code: code.code, begin }, {}, newId);

/**
 * An event with its beginning or end somewhere else; null where it would end before it begins.
 * @param {CodedEvent} event @param {"begin" | "end"} side @param {number} at s
 * @param {number} duration s @param {() => string} newId @returns {Edit | null}
 */
export const moved = (event, side, at, duration, newId) => {
  const t = rounded(Math.min(Math.max(at, 0), duration));
  const begin = side === "begin" ? t : event.begin;
  const end = side === "end" ? t : event.end;
  return end === null || end > begin ? edited(event, { begin, end }, newId) : null;
};
