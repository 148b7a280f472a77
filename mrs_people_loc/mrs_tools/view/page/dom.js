/** Making and changing elements. Texts are always set as text, never as HTML. */

/** Return the element with that id, which must exist. */
export const byId = (id) => document.getElementById(id);

/** Make an element; `attributes` without a value (null, false) are left out. */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) {
      element.setAttribute(name, value === true ? "" : value);
    }
  }
  element.append(...children);
  return element;
}

/** Set the text of an element, if it is another. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Set an attribute, if it is another; null removes it. */
export function setAttribute(element, name, value) {
  if (value === null || value === false) {
    if (element.hasAttribute(name)) element.removeAttribute(name);
  } else if (element.getAttribute(name) !== String(value)) {
    element.setAttribute(name, value);
  }
}

/**
 * Let `parent` have one child per item, in the order of the items; children are kept by key, so that
 * the focus stays where it is.
 */
export function keepChildren(parent, items, keyOf, create, update) {
  const old = new Map([...parent.children].map((child) => [child.dataset.key, child]));
  const children = items.map((item) => {
    const key = String(keyOf(item));
    const child = old.get(key) ?? create(item);
    child.dataset.key = key;
    old.delete(key);
    update(child, item);
    return child;
  });
  for (const child of old.values()) child.remove();
  if (children.some((child, index) => parent.children[index] !== child)) {
    const focused = document.activeElement;
    parent.append(...children);
    if (parent.contains(focused)) focused.focus({ preventScroll: true });
  }
}

/** Scroll the panel of an element, and nothing else, until the element is in view; it may be missing. */
export function reveal(element) {
  const panel = element?.closest("[role=tabpanel]");
  if (!panel) return;
  const [inner, outer] = [element.getBoundingClientRect(), panel.getBoundingClientRect()];
  if (inner.bottom > outer.bottom) panel.scrollTop += inner.bottom - outer.bottom;
  if (inner.top < outer.top) panel.scrollTop += inner.top - outer.top;
}
