// How the map follows mouse, pen, fingers and keys.

const TAP = 5; // a pointer that moved less than this was a click [pixels]
const NEAR = 8; // pixels within which something is hit
const FINGER = 18; // the same for a finger

/** Mouse, pen and fingers: one turns, Shift or the right button moves, two fingers move and zoom. */
function followPointer(view) {
  const { canvas } = view;
  const pointers = new Map();
  let travelled = 0;
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (pointers.size === 1) travelled = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const from = pointers.get(event.pointerId), to = [event.offsetX, event.offsetY];
    if (!from) return;
    const [dx, dy] = minus(to, from);
    travelled += Math.hypot(dx, dy);
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      const apart = (place) => lengthOf(minus(place, other)) || 1;
      view.camera.pan(dx / 2, dy / 2);
      view.camera.zoom(apart(to) / apart(from), ...sum(to, other).map((value) => value / 2));
    } else if (event.shiftKey || event.buttons & 6) view.camera.pan(dx, dy);
    else view.camera.turn(0.007 * dx, 0.007 * dy);
    pointers.set(event.pointerId, to);
    view.request(true);
  });
  const lift = (event) => {
    if (pointers.delete(event.pointerId) && event.type === "pointerup" && travelled < TAP && event.button === 0)
      view.click?.(event.offsetX, event.offsetY, event.pointerType === "touch" ? FINGER : NEAR);
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    view.camera.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), event.offsetX, event.offsetY);
    view.request(true);
  }, { passive: false });
}

/** Keys that turn, move and zoom; `more` are the view's own, {key: function}. */
function followKeys(view, more = {}) {
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const keys = {
    "+": () => view.camera.zoom(1.2), "=": () => view.camera.zoom(1.2), "-": () => view.camera.zoom(1 / 1.2), Home: () => view.camera.reset(),
    t: () => view.camera.fromAbove(), ...more,
  };
  view.canvas.addEventListener("keydown", (event) => {
    const { camera } = view;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = arrows[event.key], act = keys[event.key] ?? keys[event.key.toLowerCase()];
    if (arrow && event.shiftKey) camera.pan(-40 * arrow[0], -40 * arrow[1]);
    else if (arrow) camera.turn(0.08 * arrow[0], 0.08 * arrow[1]);
    else if (act) act();
    else return;
    event.preventDefault();
    view.request(true);
  });
}
