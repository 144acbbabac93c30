// The page: pictures come in, and what is done on it goes out.

import {read, written} from "./address.js";
import {Connection} from "./connection.js";
import {listen, modifiers} from "./gestures.js";

const SAID_FOR = 3000;
const WRITTEN_EVERY = 1000;
const FIGURES = 6;

const at = (id) => document.getElementById(id);
const canvas = at("picture");
const context = canvas.getContext("2d", {alpha: false});

let welcome = null;
let state = null;
// Whether the view is no longer the one that the scene is first shown in.
let isMoved = false;

// The token is a cookie by now.
history.replaceState(null, "", `/${location.hash}`);
let wanted = read(location.hash);

const connection = new Connection({
  told(message) {
    if (message.type === "welcome") {
      welcome = message;
      furnish();
    } else if (message.type === "compiling") {
      at("waiting").textContent = `Drawing the first picture${message.text && ": "}${message.text}.`;
    } else {
      state = message;
      update();
    }
  },
  picture(bitmap, width, height, number, kind) {
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
    }
    context.drawImage(bitmap, 0, 0);
    Object.assign(canvas.dataset, {kind, number});
    noteWhetherDone();
    at("waiting").hidden = true;
  },
  opened() {
    sendSize();
    show(wanted ?? (isMoved && state !== null ? read(written(state)) : null));
  },
  lost(reason) {
    at("gone").textContent = reason;
    at("gone").hidden = !reason;
  },
});

function show(messages) {
  if (messages === null) {
    return;
  }
  isMoved = true;
  for (const [type, fields] of Object.entries(messages)) {
    connection.say(type, fields);
  }
}

function say(type, fields) {
  isMoved = true;
  wanted = null;
  connection.say(type, fields);
}

function press(key) {
  say("key_down", {key, modifiers: []});
  say("key_up", {key, modifiers: []});
}

// Size: as many pixels as the screen has for the picture.

let size = null;

function sendSize() {
  if (size !== null) {
    connection.say("resize", size);
  }
}

// What the screen's own count may differ by from points times ratio, which are rounded.
const MISCOUNT = 2;

function measure([{devicePixelContentBoxSize: [exact] = []}]) {
  const ratio = window.devicePixelRatio;
  const count = (points, own) => {
    const made = Math.round(points * ratio);
    return Math.abs(own - made) <= MISCOUNT ? own : made;
  };
  const width = count(canvas.clientWidth, exact?.inlineSize);
  const height = count(canvas.clientHeight, exact?.blockSize);
  if (width > 0 && height > 0) {
    size = {pwidth: width, pheight: height, ratio};
    sendSize();
  }
}

const observer = new ResizeObserver(measure);
try {
  observer.observe(canvas, {box: "device-pixel-content-box"});
} catch {
  observer.observe(canvas);
}

// Pointers and keys.

// What is told of a pixel lies in the other half of a narrow page.
function pick(place) {
  at("pick").classList.toggle("above", place.y > canvas.clientHeight / 2);
  connection.say("pick", place);
}

listen(canvas, {
  say,
  click: pick,
  tap(place) {
    at("why").open = false;
    pick(place);
  },
  long(place) {
    at("why").open = true;
    pick(place);
  },
  fit: () => press("f"),
});

const TYPED = "textarea, select, input:not([type=checkbox], [type=radio])";
const PRESSED = "button, summary, input";
const OF_BUTTONS = [" ", "Enter", "ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End"];
const REPEATED = ["+", "=", "-", "_"];
const held = new Set();

window.addEventListener("keydown", (event) => {
  const {key, target} = event;
  if (event.ctrlKey || event.altKey || event.metaKey || key === "Tab") {
    return;
  }
  if (key === "Escape") {
    if (!closePanels()) {
      unpick();
    }
    canvas.focus();
    return;
  }
  if (target.matches(TYPED) || (target.matches(PRESSED) && OF_BUTTONS.includes(key))) {
    return;
  }
  const name = key.toLowerCase();
  if (key.startsWith("Arrow") || key === " ") {
    event.preventDefault();
  }
  if (event.repeat && !REPEATED.includes(key)) {
    return;
  }
  const isUsual = welcome?.has_usual_keys ?? true;
  if (name === "?" || (name === "h" && isUsual)) {
    toggle("help");
  } else if (name === "i" && isUsual) {
    at("line").hidden = !at("line").hidden;
  } else {
    held.add(key);
    say("key_down", {key, modifiers: modifiers(event)});
  }
});
window.addEventListener("keyup", (event) => {
  // With Shift, letters come in upper case: what went down may come up as another.
  for (const key of [...held].filter((one) => one.toLowerCase() === event.key.toLowerCase())) {
    held.delete(key);
    say("key_up", {key, modifiers: modifiers(event)});
  }
});
window.addEventListener("blur", () => {
  for (const key of held) {
    say("key_up", {key, modifiers: []});
  }
  held.clear();
});

// The bar and its panels.

const NARROW = window.matchMedia("(max-width: 900px)");
const openers = [...document.querySelectorAll("[data-opens]")];

function toggle(id) {
  const isOpen = !at(id).hidden;
  closePanels();
  if (!isOpen) {
    at(id).hidden = false;
    // There is room for one.
    at("pick").hidden ||= NARROW.matches;
    for (const one of openers) {
      one.setAttribute("aria-expanded", one.dataset.opens === id);
    }
  }
  return !isOpen;
}

function closePanels() {
  const open = openers.filter((one) => !at(one.dataset.opens).hidden);
  for (const one of open) {
    at(one.dataset.opens).hidden = true;
    one.setAttribute("aria-expanded", false);
  }
  return open.length > 0;
}

const buttons = [...at("bar").querySelectorAll("button")];
buttons.forEach((button, index) => {
  button.tabIndex = index === 0 ? 0 : -1;
  // What is clicked by a mouse leaves the keys to the picture.
  button.addEventListener("pointerdown", (event) => event.preventDefault());
  button.addEventListener("keydown", ({key}) => {
    const steps = {ArrowRight: 1, ArrowLeft: -1, Home: -index, End: buttons.length - 1 - index};
    if (key in steps) {
      const next = buttons[(index + steps[key] + buttons.length) % buttons.length];
      buttons.forEach((one) => (one.tabIndex = one === next ? 0 : -1));
      next.focus();
    }
  });
});
for (const opener of openers) {
  opener.addEventListener("click", (event) => {
    const isOpen = toggle(opener.dataset.opens);
    if (isOpen && opener.dataset.opens === "view") {
      copy("code");
    }
    // Who came by the keyboard goes on in the panel.
    if (isOpen && event.detail === 0) {
      at(opener.dataset.opens).querySelector("input, button, textarea")?.focus();
    }
  });
}
at("fit").addEventListener("click", () => press("f"));
at("measure-costs").addEventListener("click", () => press("m"));
at("unpick").addEventListener("click", () => {
  unpick();
  canvas.focus();
});
at("show-all").addEventListener("click", () => reveal([]));
at("color-by-object").addEventListener("change", ({target}) => {
  look({kind: target.checked ? "object_id" : "color"});
});
at("screenshot").addEventListener("click", () => {
  canvas.toBlob((picture) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(picture);
    link.download = `${(welcome?.title ?? "picture").replace(/[^\w.-]+/g, "_")}.png`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), SAID_FOR);
    tell(`saved ${link.download}`);
  }, "image/png");
});
for (const button of document.querySelectorAll("[data-copies]")) {
  button.addEventListener("click", () => copy(button.dataset.copies));
}

async function copy(id) {
  const field = at(id);
  try {
    await navigator.clipboard.writeText(field.value);
  } catch {
    // Pages that are not encrypted may not write to the clipboard otherwise.
    field.select();
    if (!document.execCommand("copy")) {
      tell("select the text to copy it");
      return;
    }
  }
  tell(id === "code" ? "copied the view as code" : "copied the address of the view");
}

let saidUntil = 0;

function tell(text) {
  at("said").textContent = text;
  clearTimeout(saidUntil);
  saidUntil = setTimeout(() => (at("said").textContent = ""), SAID_FOR);
}

// What is asked for holds until the viewer tells what came of it.
function look(changes) {
  if (state !== null) {
    Object.assign(state, changes);
    const {kind, switched, modes} = state;
    say("look", {kind, switched, modes});
  }
}

function reveal(hidden, only = null) {
  if (state !== null) {
    Object.assign(state, {hidden, only});
    say("visibility", {hidden: only === null ? hidden : [], only});
  }
}

function numbersBut(number) {
  return welcome.objects.map((one) => one.number).filter((one) => one !== number);
}

function unpick() {
  at("pick").hidden = true;
  connection.say("key_down", {key: "Escape", modifiers: []});
}

// What there is to see.

function made(name, attributes = {}, children = []) {
  const element = document.createElement(name);
  const {dataset = {}, ...rest} = attributes;
  Object.assign(element, rest);
  Object.assign(element.dataset, dataset);
  element.append(...children);
  return element;
}

function fill(table, rows) {
  table.replaceChildren(...rows.map(([name, ...cells]) =>
    made("tr", {}, [
      made("th", {scope: "row", textContent: name, colSpan: cells.length ? 1 : 2}),
      ...cells.map((cell) => made("td", {textContent: cell})),
    ])));
}

function furnish() {
  document.title = welcome.title || "RasterJIT";
  fill(at("keys"), welcome.help);
  const {has_usual_keys: isUsual, help_key: helpKey} = welcome;
  const hintOf = (key) => (isUsual ? [made("kbd", {textContent: key.toUpperCase()})] : []);
  at("measure-costs").hidden = !isUsual;
  document.querySelector("[data-opens=help]").title =
    `What mouse, fingers and keys do (${helpKey})`;
  if (!isUsual) {
    canvas.ariaLabel = `Picture of the scene. ${helpKey} lists what keys do.`;
  }
  at("kinds").replaceChildren(...welcome.kinds.map(({kind, name, key}) =>
    made("label", {}, [
      made("input", {type: "radio", name: "kind", value: kind, onchange: () => look({kind})}),
      `${name} `, made("kbd", {textContent: key}),
    ])));
  at("switches").replaceChildren(
    ...Object.keys(welcome.keys).map((name) =>
      made("label", {}, [
        made("input", {
          type: "checkbox", dataset: {effect: name}, onchange: () => switchEffect(name),
        }),
        `${name} `, ...hintOf(welcome.keys[name]),
      ])),
    ...welcome.modes.map(({key, name, modes}) =>
      made("label", {}, [
        name,
        made("select", {
          dataset: {modes: key},
          onchange: ({target}) => look({modes: {...state.modes, [key]: target.value || null}}),
        }, [
          made("option", {value: "", textContent: "off"}),
          ...Object.entries(modes).map(([value, text]) => made("option", {value, textContent: text})),
        ]),
        ...hintOf(key),
      ])),
  );
  at("nodes").replaceChildren(...welcome.objects.map(({number, name, color}) => {
    const swatch = made("i");
    swatch.style.background = `rgb(${color.join(" ")})`;
    return made("li", {}, [
      made("label", {}, [
        made("input", {
          type: "checkbox", checked: true, dataset: {number}, onchange: () => hide(number),
        }),
        swatch, made("span", {textContent: name || `object ${number}`, title: name}),
      ]),
      made("button", {
        type: "button", textContent: "Only", dataset: {only: number}, ariaLabel: `Show only ${name || `object ${number}`}`,
        onclick: () => {
          const isAlone = state?.only === number;
          reveal(isAlone ? [] : numbersBut(number), isAlone ? null : number);
        },
      }),
    ]);
  }));
  if (welcome.count > welcome.objects.length) {
    at("nodes").append(made("li", {
      className: "faint", textContent: `and ${welcome.count - welcome.objects.length} more`,
    }));
  }
}

function switchEffect(name) {
  const isSwitched = state.switched.includes(name);
  const switched = isSwitched ? state.switched.filter((one) => one !== name) : [...state.switched, name];
  look({switched});
}

function hide(number) {
  const {hidden} = state;
  const isHidden = hidden.includes(number);
  reveal(isHidden ? hidden.filter((one) => one !== number) : [...hidden, number]);
}

// What is shown.

let lastPick = 0;
let nextWriting = 0;

// A state may come before its picture.
function noteWhetherDone() {
  canvas.dataset.done = state !== null && state.is_done && `${state.number}` === canvas.dataset.number;
}

function update() {
  at("line").textContent = state.line;
  noteWhetherDone();
  for (const radio of document.querySelectorAll("[name=kind]")) {
    radio.checked = radio.value === state.kind;
  }
  at("color-by-object").checked = state.kind === "object_id";
  for (const {name, is_on: isOn, is_possible: isPossible} of state.effects) {
    const box = document.querySelector(`[data-effect="${name}"]`);
    box.checked = isOn;
    box.disabled = !(isPossible || state.switched.includes(name));
    box.title = box.disabled ? "the scene has nothing for it" : "";
  }
  for (const choice of document.querySelectorAll("[data-modes]")) {
    choice.value = state.modes[choice.dataset.modes] ?? "";
  }
  const hidden = new Set(state.hidden);
  for (const box of document.querySelectorAll("[data-number]")) {
    box.checked = !hidden.has(Number(box.dataset.number));
  }
  for (const button of document.querySelectorAll("[data-only]")) {
    button.ariaPressed = state.only === Number(button.dataset.only);
  }
  fill(at("costs"), state.costs);
  updatePick();
  updateView();
}

function updatePick() {
  const {picked} = state;
  if (picked === null || picked.count === lastPick) {
    at("pick").hidden ||= picked === null;
    lastPick = picked?.count ?? 0;
    return;
  }
  lastPick = picked.count;
  const rows = [];
  if (picked.position !== null) {
    rows.push(["object", String(picked.object)], ["face", String(picked.face)]);
    rows.push(["position", picked.position.map((part) => part.toPrecision(FIGURES)).join("  ")]);
  }
  if (picked.distance !== null) {
    rows.push(["distance", `${picked.distance.toPrecision(FIGURES)} from the point picked before`]);
  }
  at("pick-name").textContent = picked.name;
  fill(at("picked"), rows);
  fill(at("reasons"), picked.rows);
  closePanels();
  at("pick").hidden = false;
  at("heard").textContent = [picked.name, ...rows.map((row) => row.join(" "))].join(", ");
}

function updateView() {
  at("code").value = state.code;
  at("address").value = `${location.origin}/${written(state)}`;
  clearTimeout(nextWriting);
  if (isMoved) {
    nextWriting = setTimeout(() => history.replaceState(null, "", written(state)), WRITTEN_EVERY);
  }
}

window.addEventListener("hashchange", () => {
  show(read(location.hash));
});

canvas.focus();
