// Show image INDEX of a contact sheet of [columns, rows] images in ELEMENT; -1 is none.
const sprite = (element, [columns, rows], index) => {
  element.classList.toggle("empty", index < 0);
  const x = index % columns, y = Math.floor(index / columns);
  element.style.backgroundPosition =
    (columns > 1 ? (100 * x) / (columns - 1) : 0) + "% " + (rows > 1 ? (100 * y) / (rows - 1) : 0) + "%";
};
