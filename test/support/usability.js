// What keeps people from using a page: each function returns the elements that do.
(() => {
  const INPUTS = "button, select, a, summary, input";
  const visible = (selector) => [...document.querySelectorAll(selector)].filter((one) => one.checkVisibility() && one.getBoundingClientRect().width);
  const nameOf = (one) => one.id || one.textContent.trim().slice(0, 40) || one.outerHTML.slice(0, 80);

  return {
    cutOff: visible(INPUTS).filter((one) => !one.closest("#cards")).filter((one) => {
      const { left, right } = one.getBoundingClientRect();
      return left < -1 || right > innerWidth + 1;
    }).map(nameOf),
    small: visible(INPUTS).filter((one) => one.type !== "file").filter((one) => {
      const { width, height } = ((one.type === "checkbox" && one.closest("label")) || one).getBoundingClientRect();
      return width < 43.5 || height < 43.5;
    }).map(nameOf),
  };
})()
