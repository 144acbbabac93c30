// What mouse and fingers do on the picture, in words that the viewer knows.

const CLICK = 3;
const TAP = 10;
const LONG = 500;
const DOUBLE = 300;
const DOUBLE_REACH = 40;
const ZOOM = 1000;
const PINCH_OF_PAD = 8;
const LINE = 16;
const MIN_SPREAD = 10;

const TURN = 1;
const PAN = 3;
const BUTTONS = [1, 3, 2];

export function modifiers(event) {
  return ["Alt", "Control", "Meta", "Shift"].filter(
    (_, index) => [event.altKey, event.ctrlKey, event.metaKey, event.shiftKey][index],
  );
}

// `say` sends a message; the others are what a click, a tap, a long and a double one do.
export function listen(canvas, {say, click, tap, long, fit}) {
  const fingers = new Map();
  let drag = null;
  let pinch = null;
  let held = 0;
  let lastTap = null;

  const tell = (type, place, button, keys = []) =>
    say(type, {
      ...place, button, buttons: type === "pointer_up" ? [] : [button], modifiers: keys,
    });
  const placeOf = (event) => {
    const box = canvas.getBoundingClientRect();
    return {x: event.clientX - box.left, y: event.clientY - box.top};
  };
  const apart = (a, b) => Math.hypot(a.x - b.x, a.y - b.y);

  function press(place, button, keys, reach) {
    drag = {start: place, last: place, button, keys, reach, isMoving: false, isOver: false};
  }

  function move(place) {
    if (!drag.isMoving && apart(place, drag.start) > drag.reach) {
      clearTimeout(held);
      drag.isMoving = true;
      tell("pointer_down", drag.start, drag.button, drag.keys);
    }
    drag.last = place;
    if (drag.isMoving) {
      tell("pointer_move", place, drag.button, drag.keys);
    }
  }

  // Ends a drag; true if it was none, but a click.
  function release(place) {
    clearTimeout(held);
    const ended = drag;
    drag = null;
    if (ended?.isMoving) {
      tell("pointer_up", place, ended.button, ended.keys);
    }
    return ended !== null && !ended.isMoving && !ended.isOver;
  }

  function between() {
    const [a, b] = [...fingers.values()];
    const place = {x: (a.x + b.x) / 2, y: (a.y + b.y) / 2};
    return {place, spread: Math.max(apart(a, b), MIN_SPREAD)};
  }

  function touchDown(event, place) {
    fingers.set(event.pointerId, place);
    if (fingers.size === 1) {
      press(place, TURN, [], TAP);
      const pressed = drag;
      held = setTimeout(() => {
        pressed.isOver = true;
        long(place);
      }, LONG);
    } else if (fingers.size === 2) {
      release(drag?.last ?? place);
      pinch = {...between(), frame: 0};
      tell("pointer_down", pinch.place, PAN);
    }
  }

  // Both fingers of a pinch move at once, but are told of one after the other.
  function followPinch() {
    cancelAnimationFrame(pinch.frame);
    pinch.frame = 0;
    const now = between();
    const turned = -ZOOM * Math.log(now.spread / pinch.spread);
    if (apart(now.place, pinch.place) > 0) {
      tell("pointer_move", now.place, PAN);
    }
    if (turned !== 0) {
      say("wheel", {...now.place, dx: 0, dy: turned, modifiers: []});
    }
    Object.assign(pinch, now);
  }

  function touchMove(event, place) {
    fingers.set(event.pointerId, place);
    if (pinch !== null) {
      pinch.frame ||= requestAnimationFrame(followPinch);
    } else if (drag !== null && !drag.isOver) {
      move(place);
    }
  }

  function touchUp(event, place) {
    if (pinch !== null) {
      followPinch();
    }
    const isLast = fingers.delete(event.pointerId) && fingers.size === 0;
    if (pinch !== null) {
      tell("pointer_up", pinch.place, PAN);
      pinch = null;
      // The other finger goes on turning.
      const [left] = fingers.values();
      press(left, TURN, [], TAP);
      drag.isPinched = true;
      return;
    }
    const isPinched = drag?.isPinched;
    if (isLast && release(place) && !isPinched && event.type === "pointerup") {
      tapAt(place);
    }
  }

  function tapAt(place) {
    if (lastTap !== null && apart(lastTap.place, place) < DOUBLE_REACH) {
      clearTimeout(lastTap.timer);
      lastTap = null;
      fit();
      return;
    }
    const timer = setTimeout(() => {
      lastTap = null;
      tap(place);
    }, DOUBLE);
    lastTap = {place, timer};
  }

  canvas.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    canvas.focus({preventScroll: true});
    canvas.setPointerCapture(event.pointerId);
    const place = placeOf(event);
    if (event.pointerType === "touch") {
      if (fingers.size < 2) {
        touchDown(event, place);
      }
    } else if (drag === null) {
      press(place, BUTTONS[event.button] ?? TURN, modifiers(event), CLICK);
    }
  });
  canvas.addEventListener("pointermove", (event) => {
    if (event.pointerType === "touch") {
      if (fingers.has(event.pointerId)) {
        touchMove(event, placeOf(event));
      }
    } else if (drag !== null) {
      move(placeOf(event));
    }
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(kind, (event) => {
      if (event.pointerType === "touch") {
        if (fingers.has(event.pointerId)) {
          touchUp(event, placeOf(event));
        }
      } else if (event.buttons === 0 || kind === "pointercancel") {
        const button = drag?.button;
        if (release(placeOf(event)) && button === TURN && kind === "pointerup") {
          click(placeOf(event));
        }
      }
    });
  }
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const unit = [1, LINE, canvas.clientHeight][event.deltaMode] * (event.ctrlKey ? PINCH_OF_PAD : 1);
    const turned = {dx: event.deltaX * unit, dy: event.deltaY * unit};
    say("wheel", {...placeOf(event), ...turned, modifiers: modifiers(event)});
  }, {passive: false});
}
