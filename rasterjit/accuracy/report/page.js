// Show the picture of the point under the mouse, the finger or the focus against the reference.
// A module: nothing in it is global.

const element = (id) => document.getElementById(id);
const points = [...document.querySelectorAll("input[name=point]")];
const split = document.querySelector(".split");

// A mouse on its way to the picture crosses points: it shows one that it rests on.
const REST = 90;

// A line may end between options, not within one.
function word(text) {
  const span = document.createElement("span");
  span.className = "word";
  span.textContent = text;
  return span;
}

function show(point) {
  const shot = element(point.value);
  const group = shot.closest(".group");
  const [color, error] = shot.querySelectorAll("img");
  const part = element("part");
  point.checked = true;
  element("reference").src = group.querySelector(".true img").src;
  element("chosen").src = color.src;
  element("chosen").alt = point.dataset.name;
  element("error").src = error.src;
  element("error").alt = `error of each pixel of ${point.dataset.name}`;
  element("top").textContent = group.dataset.top;
  for (const id of ["left", "name"]) {
    element(id).textContent = point.dataset.name;
  }
  element("found").textContent = point.dataset.found;
  element("options").replaceChildren(...point.dataset.options.split(/(?<= )(?=--)/).map(word));
  part.setAttribute("x", group.dataset.column);
  part.setAttribute("y", group.dataset.row);
  part.setAttribute("width", color.naturalWidth);
  part.setAttribute("height", color.naturalHeight);
}

function divide() {
  const { value } = element("share");
  split.style.setProperty("--share", `${value}%`);
  element("share").setAttribute("aria-valuetext", `${value} % ${element("chosen").alt}`);
}

for (const point of points) {
  let resting = 0;
  point.addEventListener("change", () => show(point));
  point.addEventListener("pointerenter", (event) => {
    if (event.pointerType === "mouse") {
      resting = setTimeout(show, REST, point);
    }
  });
  point.addEventListener("pointerleave", () => clearTimeout(resting));
}
element("share").addEventListener("input", divide);

// Points that lie on each other are chosen in the tables.
for (const button of document.querySelectorAll(".pick")) {
  button.disabled = false;
  button.addEventListener("click", () => {
    show(points.find((point) => point.dataset.name === button.dataset.name));
    element("viewer").scrollIntoView({ block: "nearest" });
  });
}

// What is folded is printed too, and folded again after.
let opened = [];
addEventListener("beforeprint", () => {
  opened = [...document.querySelectorAll("details:not([open])")];
  opened.forEach((details) => { details.open = true; });
});
addEventListener("afterprint", () => {
  opened.forEach((details) => { details.open = false; });
});

element("viewer").hidden = false;
addEventListener("load", () => show(points.find((point) => point.checked)));
divide();
