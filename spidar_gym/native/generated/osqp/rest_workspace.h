/* Generated: the workspace of OSQP for rest. */
#ifndef REST_WORKSPACE_H
#define REST_WORKSPACE_H

#include <stddef.h>
#include <stdint.h>
#include "types.h"
#include "algebra_impl.h"
#include "qdldl_interface.h"

typedef struct {
    OSQPSettings settings;
    OSQPFloat sol_x[24];
    OSQPFloat sol_y[24];
    OSQPFloat sol_prim_inf_cert[24];
    OSQPFloat sol_dual_inf_cert[24];
    OSQPSolution sol;
    OSQPInfo info;
    OSQPInt data_P_csc_p[25];
    OSQPInt data_P_csc_i[84];
    OSQPFloat data_P_csc_x[84];
    OSQPCscMatrix data_P_csc;
    OSQPMatrix data_P;
    OSQPInt data_A_csc_p[25];
    OSQPInt data_A_csc_i[24];
    OSQPFloat data_A_csc_x[24];
    OSQPCscMatrix data_A_csc;
    OSQPMatrix data_A;
    OSQPFloat data_q_val[24];
    OSQPVectorf data_q;
    OSQPFloat data_l_val[24];
    OSQPVectorf data_l;
    OSQPFloat data_u_val[24];
    OSQPVectorf data_u;
    OSQPData data;
    OSQPInt linsys_L_p[49];
    OSQPInt linsys_L_i[84];
    OSQPFloat linsys_L_x[84];
    OSQPCscMatrix linsys_L;
    OSQPFloat linsys_Dinv[48];
    OSQPInt linsys_P[48];
    OSQPFloat linsys_bp[48];
    OSQPFloat linsys_sol[48];
    OSQPFloat linsys_rho_inv_vec[24];
    OSQPInt linsys_KKT_p[49];
    OSQPInt linsys_KKT_i[132];
    OSQPFloat linsys_KKT_x[132];
    OSQPCscMatrix linsys_KKT;
    OSQPInt linsys_PtoKKT[84];
    OSQPInt linsys_AtoKKT[24];
    OSQPInt linsys_rhotoKKT[24];
    OSQPFloat linsys_D[48];
    OSQPInt linsys_etree[48];
    OSQPInt linsys_Lnz[48];
    QDLDL_int linsys_iwork[144];
    QDLDL_bool linsys_bwork[48];
    QDLDL_float linsys_fwork[48];
    qdldl_solver linsys;
    OSQPFloat work_rho_vec_val[24];
    OSQPVectorf work_rho_vec;
    OSQPFloat work_rho_inv_vec_val[24];
    OSQPVectorf work_rho_inv_vec;
    OSQPInt work_constr_type_val[24];
    OSQPVectori work_constr_type;
    OSQPFloat work_x_val[24];
    OSQPVectorf work_x;
    OSQPFloat work_y_val[24];
    OSQPVectorf work_y;
    OSQPFloat work_z_val[24];
    OSQPVectorf work_z;
    OSQPFloat work_xz_tilde_val[48];
    OSQPVectorf work_xz_tilde;
    OSQPVectorf work_xtilde_view;
    OSQPVectorf work_ztilde_view;
    OSQPFloat work_x_prev_val[24];
    OSQPVectorf work_x_prev;
    OSQPFloat work_z_prev_val[24];
    OSQPVectorf work_z_prev;
    OSQPFloat work_Ax_val[24];
    OSQPVectorf work_Ax;
    OSQPFloat work_Px_val[24];
    OSQPVectorf work_Px;
    OSQPFloat work_Aty_val[24];
    OSQPVectorf work_Aty;
    OSQPFloat work_delta_y_val[24];
    OSQPVectorf work_delta_y;
    OSQPFloat work_Atdelta_y_val[24];
    OSQPVectorf work_Atdelta_y;
    OSQPFloat work_delta_x_val[24];
    OSQPVectorf work_delta_x;
    OSQPFloat work_Pdelta_x_val[24];
    OSQPVectorf work_Pdelta_x;
    OSQPFloat work_Adelta_x_val[24];
    OSQPVectorf work_Adelta_x;
    OSQPFloat work_D_temp_val[24];
    OSQPVectorf work_D_temp;
    OSQPFloat work_D_temp_A_val[24];
    OSQPVectorf work_D_temp_A;
    OSQPFloat work_E_temp_val[24];
    OSQPVectorf work_E_temp;
    OSQPWorkspace work;
    OSQPSolver solver;
} rest_space;
extern const rest_space rest_SPACE;
static const uint32_t rest_POINTERS[89] = {
    offsetof(rest_space, sol) + offsetof(OSQPSolution, x), offsetof(rest_space, sol) + offsetof(OSQPSolution, y), offsetof(rest_space, sol) + offsetof(OSQPSolution, prim_inf_cert), offsetof(rest_space, sol) + offsetof(OSQPSolution, dual_inf_cert),
    offsetof(rest_space, data_P_csc) + offsetof(OSQPCscMatrix, p), offsetof(rest_space, data_P_csc) + offsetof(OSQPCscMatrix, i), offsetof(rest_space, data_P_csc) + offsetof(OSQPCscMatrix, x), offsetof(rest_space, data_P) + offsetof(OSQPMatrix, csc),
    offsetof(rest_space, data_A_csc) + offsetof(OSQPCscMatrix, p), offsetof(rest_space, data_A_csc) + offsetof(OSQPCscMatrix, i), offsetof(rest_space, data_A_csc) + offsetof(OSQPCscMatrix, x), offsetof(rest_space, data_A) + offsetof(OSQPMatrix, csc),
    offsetof(rest_space, data_q) + offsetof(OSQPVectorf, values), offsetof(rest_space, data_l) + offsetof(OSQPVectorf, values), offsetof(rest_space, data_u) + offsetof(OSQPVectorf, values), offsetof(rest_space, data) + offsetof(OSQPData, P),
    offsetof(rest_space, data) + offsetof(OSQPData, A), offsetof(rest_space, data) + offsetof(OSQPData, q), offsetof(rest_space, data) + offsetof(OSQPData, l), offsetof(rest_space, data) + offsetof(OSQPData, u),
    offsetof(rest_space, linsys_L) + offsetof(OSQPCscMatrix, p), offsetof(rest_space, linsys_L) + offsetof(OSQPCscMatrix, i), offsetof(rest_space, linsys_L) + offsetof(OSQPCscMatrix, x), offsetof(rest_space, linsys_KKT) + offsetof(OSQPCscMatrix, p),
    offsetof(rest_space, linsys_KKT) + offsetof(OSQPCscMatrix, i), offsetof(rest_space, linsys_KKT) + offsetof(OSQPCscMatrix, x), offsetof(rest_space, linsys) + offsetof(qdldl_solver, L), offsetof(rest_space, linsys) + offsetof(qdldl_solver, Dinv),
    offsetof(rest_space, linsys) + offsetof(qdldl_solver, P), offsetof(rest_space, linsys) + offsetof(qdldl_solver, bp), offsetof(rest_space, linsys) + offsetof(qdldl_solver, sol), offsetof(rest_space, linsys) + offsetof(qdldl_solver, rho_inv_vec),
    offsetof(rest_space, linsys) + offsetof(qdldl_solver, KKT), offsetof(rest_space, linsys) + offsetof(qdldl_solver, PtoKKT), offsetof(rest_space, linsys) + offsetof(qdldl_solver, AtoKKT), offsetof(rest_space, linsys) + offsetof(qdldl_solver, rhotoKKT),
    offsetof(rest_space, linsys) + offsetof(qdldl_solver, D), offsetof(rest_space, linsys) + offsetof(qdldl_solver, etree), offsetof(rest_space, linsys) + offsetof(qdldl_solver, Lnz), offsetof(rest_space, linsys) + offsetof(qdldl_solver, iwork),
    offsetof(rest_space, linsys) + offsetof(qdldl_solver, bwork), offsetof(rest_space, linsys) + offsetof(qdldl_solver, fwork), offsetof(rest_space, work_rho_vec) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_rho_inv_vec) + offsetof(OSQPVectorf, values),
    offsetof(rest_space, work_constr_type) + offsetof(OSQPVectori, values), offsetof(rest_space, work_x) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_y) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_z) + offsetof(OSQPVectorf, values),
    offsetof(rest_space, work_xz_tilde) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_xtilde_view) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_ztilde_view) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_x_prev) + offsetof(OSQPVectorf, values),
    offsetof(rest_space, work_z_prev) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_Ax) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_Px) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_Aty) + offsetof(OSQPVectorf, values),
    offsetof(rest_space, work_delta_y) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_Atdelta_y) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_delta_x) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_Pdelta_x) + offsetof(OSQPVectorf, values),
    offsetof(rest_space, work_Adelta_x) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_D_temp) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_D_temp_A) + offsetof(OSQPVectorf, values), offsetof(rest_space, work_E_temp) + offsetof(OSQPVectorf, values),
    offsetof(rest_space, work) + offsetof(OSQPWorkspace, data), offsetof(rest_space, work) + offsetof(OSQPWorkspace, linsys_solver), offsetof(rest_space, work) + offsetof(OSQPWorkspace, rho_vec), offsetof(rest_space, work) + offsetof(OSQPWorkspace, rho_inv_vec),
    offsetof(rest_space, work) + offsetof(OSQPWorkspace, constr_type), offsetof(rest_space, work) + offsetof(OSQPWorkspace, x), offsetof(rest_space, work) + offsetof(OSQPWorkspace, y), offsetof(rest_space, work) + offsetof(OSQPWorkspace, z),
    offsetof(rest_space, work) + offsetof(OSQPWorkspace, xz_tilde), offsetof(rest_space, work) + offsetof(OSQPWorkspace, xtilde_view), offsetof(rest_space, work) + offsetof(OSQPWorkspace, ztilde_view), offsetof(rest_space, work) + offsetof(OSQPWorkspace, x_prev),
    offsetof(rest_space, work) + offsetof(OSQPWorkspace, z_prev), offsetof(rest_space, work) + offsetof(OSQPWorkspace, Ax), offsetof(rest_space, work) + offsetof(OSQPWorkspace, Px), offsetof(rest_space, work) + offsetof(OSQPWorkspace, Aty),
    offsetof(rest_space, work) + offsetof(OSQPWorkspace, delta_y), offsetof(rest_space, work) + offsetof(OSQPWorkspace, Atdelta_y), offsetof(rest_space, work) + offsetof(OSQPWorkspace, delta_x), offsetof(rest_space, work) + offsetof(OSQPWorkspace, Pdelta_x),
    offsetof(rest_space, work) + offsetof(OSQPWorkspace, Adelta_x), offsetof(rest_space, solver) + offsetof(OSQPSolver, settings), offsetof(rest_space, solver) + offsetof(OSQPSolver, solution), offsetof(rest_space, solver) + offsetof(OSQPSolver, info),
    offsetof(rest_space, solver) + offsetof(OSQPSolver, work),
};

#endif
