"""Style sheet of all pages, for any screen or paper, light or dark."""

from __future__ import annotations

_COLOURS = """
:root{color-scheme:light dark;--paper:#fff;--ink:#1a1d21;--soft:#565d66;--line:#d5d9de;
--panel:#f5f6f8;--link:#0b4fb3;--data:#2b62b8;--good:#176b34;--fair:#7a5200;
--bad:#ab2019;
--good-bg:#def3e3;--fair-bg:#fbecc6;--bad-bg:#fbdedb;--mark:#ffd24d;--over:#ff8f7d}
@media (prefers-color-scheme:dark){:root{--paper:#15181b;--ink:#e8eaed;--soft:#a9b1ba;
--line:#3a4047;--panel:#1e2226;--link:#8fb8ff;--data:#7faaf5;--good:#79d492;
--fair:#ecc15c;
--bad:#ff9c92;--good-bg:#1b3a25;--fair-bg:#40330f;--bad-bg:#4a211e}}
"""
_TEXT = """
*{box-sizing:border-box}
html{font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Noto Sans",
"Liberation Sans",
"DejaVu Sans",sans-serif;-webkit-text-size-adjust:100%;scroll-padding-top:1rem}
body{margin:0;background:var(--paper);color:var(--ink);overflow-wrap:anywhere;
font-variant-numeric:tabular-nums}
header,main,footer{max-width:70rem;margin:0 auto;padding:0 1.25rem}
h1{font-size:1.9rem;line-height:1.2;margin:.1rem 0 .4rem}
h2{font-size:1.35rem;line-height:1.25;margin:3.2rem 0 .6rem;padding-top:.8rem;
border-top:2px solid var(--line)}
h3{font-size:1.08rem;margin:2rem 0 .5rem}
h4{font-size:.95rem;margin:1.4rem 0 .4rem}
p{margin:.4rem 0 .8rem;max-width:46rem}
a{color:var(--link)}
.skip{position:absolute;left:-99rem;background:var(--paper);padding:.5rem 1rem;
z-index:9}
.skip:focus{left:.5rem;top:.5rem}
.kicker{color:var(--soft);font-size:.85rem;margin:1.2rem 0 0}
.lead{font-size:1.12rem}
.first h2{margin:1.8rem 0 .4rem}
.soft,figcaption,.note{color:var(--soft)}
.note{font-size:.9rem}
.good{color:var(--good)}.fair{color:var(--fair)}.bad{color:var(--bad)}
.verdict{font-weight:600}
code.whole{white-space:nowrap}
code,.hash{font-family:ui-monospace,"SF Mono",Menlo,Consolas,"Liberation Mono",
"DejaVu Sans Mono",monospace;font-size:.86em}
.cols{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,19rem),1fr));
gap:1.2rem 2rem;align-items:start}
.facts{display:grid;
grid-template-columns:repeat(auto-fit,minmax(min(100%,9.5rem),1fr));
gap:.7rem 1.6rem;margin:.8rem 0 1.2rem}
.facts dt{color:var(--soft);font-size:.82rem}.facts dd{margin:0;font-weight:600}
.facts dd small{display:block;color:var(--soft);font-weight:400;font-size:.82rem}
ul.contents{columns:3 15rem;padding-left:1.1rem;margin:.4rem 0}
ul.contents li{break-inside:avoid;padding:.1rem 0}
footer{margin-top:3rem;padding-bottom:3rem;color:var(--soft);font-size:.85rem}
"""
_TABLES = """
.wide{overflow-x:auto;margin:.5rem 0 1rem}
.wide:focus-visible,a:focus-visible,summary:focus-visible{outline:2px solid var(--link);
outline-offset:2px}
table{border-collapse:collapse;font-size:.88rem;width:100%}
caption{text-align:left;color:var(--soft);padding:.2rem 0 .4rem}
th,td{text-align:left;vertical-align:top;padding:.32rem .8rem .32rem 0;
border-bottom:1px solid var(--line);overflow-wrap:break-word}
thead th{color:var(--soft);font-weight:600;border-bottom:2px solid var(--line)}
tbody th{font-weight:600}
td.n,th.n{text-align:right;white-space:nowrap;padding-right:1.6rem}
tr:target{outline:2px solid var(--link)}
details{margin:.7rem 0}
summary{cursor:pointer;font-weight:600;padding:.25rem 0}
table.map{width:100%;max-width:34rem}
table.map td{text-align:center;border:2px solid var(--paper);padding:.35rem .25rem;
background:var(--panel)}
table.map td small{display:block;white-space:nowrap}
table.map th{font-size:.78rem;border:0;padding:.35rem .4rem .35rem 0}
table.map thead th{text-align:center;padding:.2rem .2rem;vertical-align:bottom}
table.map thead td{background:none;border:0}
table.map td.good{background:var(--good-bg);color:var(--good)}
table.map td.fair{background:var(--fair-bg);color:var(--fair)}
table.map td.bad{background:var(--bad-bg);color:var(--bad)}
table.map td.none{color:var(--soft)}
@media (max-width:40rem){table.stack thead{display:none}
table.stack tr{display:block;padding:.5rem 0;border-bottom:1px solid var(--line)}
table.stack td,table.stack th{display:block;border:0;padding:.05rem 0;text-align:left;
white-space:normal}
table.stack td[data-of]::before{content:attr(data-of) ": ";color:var(--soft)}
table.map td{min-width:0;padding:.3rem .25rem;font-size:.8rem}
table.map th{padding-right:.3rem;white-space:normal}
table.map td small{white-space:normal}}
"""
_FIGURES = """
figure{margin:.6rem 0 1.4rem;break-inside:avoid;min-width:0}
figcaption{font-size:.86rem;line-height:1.42;margin-top:.5rem;max-width:46rem}
figcaption strong{color:var(--ink);display:block}
figcaption span{display:block;margin-top:.15rem}
figcaption .do{color:var(--ink)}
svg,img{max-width:100%;height:auto;display:block}
svg.chart{width:100%;max-width:31rem}
svg.chart text{font-size:11px;fill:var(--ink);stroke:var(--paper);stroke-width:3px;
paint-order:stroke;stroke-linejoin:round}
svg.chart .tick{fill:var(--soft);font-size:10.5px}
.mid{text-anchor:middle}.end{text-anchor:end}
svg .grid{stroke:var(--line);stroke-width:.7}
svg .axis{stroke:var(--soft);stroke-width:1}
svg .limit{stroke:var(--bad);stroke-width:1.4;stroke-dasharray:5 3}
svg.chart text.limit{fill:var(--bad);stroke:var(--paper);stroke-width:3px;
stroke-dasharray:none}
svg .curve{fill:none;stroke:var(--data);stroke-width:2}
svg .front{fill:none;stroke:var(--soft);stroke-width:1.2}
svg.chart .number{font-weight:600}
svg .band{fill:var(--data);opacity:.16}
svg .dot{fill:var(--data)}
svg .ring{fill:var(--paper);stroke:var(--data);stroke-width:1.6}
svg .cross{fill:none;stroke:var(--bad);stroke-width:1.6}
svg .pick{fill:none;stroke:var(--ink);stroke-width:1.8}
svg .bar{fill:var(--data)}svg .bar.b1{opacity:.55}svg .bar.b2{fill:var(--fair)}
svg .bar.b3{fill:var(--good)}svg .bar.sum{fill:var(--ink)}
svg .here{stroke:var(--ink);stroke-width:1.2}
svg .ell{fill:var(--data);fill-opacity:.14;stroke:var(--data);stroke-width:1.5}
svg .room{fill:none;stroke:var(--bad);stroke-width:1.5;stroke-dasharray:5 3}
"""
_PICTURES = """
.shot{background:#000}
.shot img,.shot svg{width:100%;display:block}
.pixels{image-rendering:pixelated}
.views{border:0;padding:0;margin:0;min-width:0}
.views legend{padding:0;font-size:.86rem;color:var(--soft);margin-bottom:.3rem}
.views>input{position:absolute;opacity:0;width:1px;height:1px}
.views>label{display:inline-block;border:1px solid var(--line);border-radius:.3rem;
padding:.15rem .6rem;margin:0 .35rem .5rem 0;font-size:.86rem;cursor:pointer}
.views>input:checked+label{background:var(--ink);color:var(--paper);
border-color:var(--ink)}
.views>input:focus-visible+label{outline:2px solid var(--link);outline-offset:2px}
.pane{align-items:start;display:grid;
grid-template-columns:repeat(auto-fit,minmax(min(100%,18rem),1fr));
gap:.8rem}
.drawn{visibility:hidden}
.views>.as-image:checked~.pane .marks{visibility:hidden}
.views>.as-drawing:checked~.pane .drawn,.views>.as-flicker:checked~.pane .drawn
{visibility:visible}
.views>.as-flicker:checked~.pane .marks{visibility:hidden}
.views>.as-flicker:checked~.pane .drawn{animation:flick 1.6s steps(1) infinite}
@keyframes flick{0%{opacity:1}50%{opacity:0}}
@media (prefers-reduced-motion:reduce){.views>.as-flicker:checked~.pane .drawn
{animation:none;opacity:.5}}
.marks *,.drawn *{vector-effect:non-scaling-stroke}
.marks .case{fill:none;stroke:#000;stroke-opacity:.75;stroke-width:3.4}
.marks .feature{fill:none;stroke:var(--mark);stroke-width:1.7}
.marks .region{fill:none;stroke:#fff;stroke-width:1.5;stroke-dasharray:6 4}
.marks .occluder{fill:none;stroke:var(--over);stroke-width:1.7;stroke-dasharray:2 3}
.marks .body{fill:none;stroke:#9ec5ff;stroke-width:1.2}
.marks .where{fill:none;stroke:none}
.marks g:target .where{stroke:#9ec5ff;stroke-width:4}
.marks g:target .feature,.marks g:target .occluder,.marks g:target .body,
.marks g:target .region{stroke-width:5;stroke-dasharray:none}
.strip{display:grid;
grid-template-columns:repeat(auto-fill,minmax(min(100%,8.2rem),1fr));
gap:.7rem;max-width:52rem}
.strip.wide-tiles{grid-template-columns:repeat(auto-fill,
minmax(min(100%,20rem),1fr))}
.strip div{min-width:0}.strip p{font-size:.82rem;margin:.25rem 0 0}
.strip img{width:100%;background:#000}
.key{list-style:none;display:flex;flex-wrap:wrap;gap:.2rem 1.1rem;padding:0;
margin:.5rem 0;
font-size:.84rem}
.key svg{display:inline-block;width:1.7rem;height:.9rem;background:#2a2d31;
border-radius:.15rem;vertical-align:-.1rem;margin-right:.35rem}
.key.plain svg{background:none}
.key.numbers{list-style:decimal;display:block;columns:2 14rem;padding-left:1.6rem}
.key.numbers li{break-inside:avoid}
"""
_PAPER = """
@media print{:root{--paper:#fff;--ink:#000;--soft:#444;--line:#bbb;--panel:#f4f4f4;
--link:#000;--data:#2b62b8;--good:#176b34;--fair:#7a5200;--bad:#ab2019;
--good-bg:#def3e3;
--fair-bg:#fbecc6;--bad-bg:#fbdedb;color-scheme:light}
@page{margin:12mm 13mm}
html{font-size:10pt;line-height:1.38}
header,main,footer{max-width:none;padding:0}
.skip,.views>label,.views>input,.views legend{display:none}
a{text-decoration:none}
p{max-width:none}
h1{font-size:16pt;margin:0 0 1mm}.kicker{margin:0}
.first{break-after:page}
.first h2{font-size:11.5pt;margin:4mm 0 1mm;padding-top:2mm;
border-top:1px solid var(--line)}
.first p{margin:1mm 0 1.6mm}.first figure{margin:0}
.first .facts{margin:2mm 0 2mm;gap:1mm 4mm;grid-template-columns:repeat(4,1fr)}
.first .cols{grid-template-columns:repeat(3,1fr);gap:4mm}
.first figcaption{font-size:8.2pt;line-height:1.3;margin-top:1mm}
.first table{font-size:9.3pt}.first th,.first td{padding:.5mm 2mm .5mm 0}
.first .methods{font-size:8.4pt;line-height:1.3}
h2{break-after:avoid;margin-top:7mm}h3,h4{break-after:avoid}
tr,figure{break-inside:avoid}
.wide{overflow:visible}
details::details-content{content-visibility:visible;display:block;height:auto}
.marks{visibility:visible!important}.drawn{visibility:hidden!important;animation:none}
*{print-color-adjust:exact;-webkit-print-color-adjust:exact}}
"""

STYLE = "".join(
    (_COLOURS, _TEXT, _TABLES, _FIGURES, _PICTURES, _PAPER)
)  # one page, one sheet
