// What keeps people from using a page: each function returns the elements that do.
(() => {
  const INPUTS = "button, select, a, summary, input";
  const visible = (selector) => [...document.querySelectorAll(selector)].filter((one) => one.checkVisibility() && one.getBoundingClientRect().width);
  const nameOf = (one) => one.id || one.textContent.trim().slice(0, 40) || one.outerHTML.slice(0, 80);
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });

  function parts(colour) {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = colour;
    canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  }

  /** Relative luminance, WCAG 2.2. */
  function luminance(colour) {
    const [red, green, blue] = parts(colour).map((one) => one / 255).map((one) => (one <= 0.04045 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4));
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
  }

  function background(node) {
    for (; node; node = node.parentElement) {
      const colour = getComputedStyle(node).backgroundColor;
      if (parts(colour)[3] > 250) return colour;
    }
    return "white";
  }

  function contrast(one) {
    const [light, dark] = [getComputedStyle(one).color, background(one)].map(luminance).sort((a, b) => b - a);
    return (light + 0.05) / (dark + 0.05);
  }

  const hasText = (one) => [...one.childNodes].some((child) => child.nodeType === Node.TEXT_NODE && child.textContent.trim());

  return {
    cutOff: visible(INPUTS).filter((one) => !one.closest("#cards")).filter((one) => {
      const { left, right } = one.getBoundingClientRect();
      return left < -1 || right > innerWidth + 1;
    }).map(nameOf),
    small: visible(INPUTS).filter((one) => one.type !== "file").filter((one) => {
      const { width, height } = ((one.type === "checkbox" && one.closest("label")) || one).getBoundingClientRect();
      return width < 43.5 || height < 43.5;
    }).map(nameOf),
    nameless: visible(INPUTS).filter((one) => !(one.tagName !== "SELECT" && one.textContent.trim()) && !one.getAttribute("aria-label") && !one.getAttribute("aria-labelledby") && !one.labels?.[0]?.textContent.trim()).map(nameOf),
    pale: visible("body *").filter((one) => hasText(one) && !one.closest("svg, #camera, :disabled, [inert]") && contrast(one) < 4.5).map((one) => `${nameOf(one)}: ${contrast(one).toFixed(1)}`),
  };
})()
